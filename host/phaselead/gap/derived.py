"""What the parameters of a named effect come to as a person means them: a bow's peak, a drift's mean rate."""

from __future__ import annotations

import numpy as np

from phaselead.gap.error_rates import TWO_SIDED_95
from phaselead.gap.findings import Estimate, NamedEffect, Posterior
from phaselead.model import Scene, derived_sizes
from phaselead.record import Samples


def derived_of(effect: NamedEffect, scene: Scene) -> dict[str, Estimate]:
    """Value, unit and 95 % interval of each derived size, by name.

    The value is that of the parameters that are adopted. Its interval is as wide as the posterior of all parameters
    together, about the most likely ones, and as far as the two values differ wider to either side: of two parameters
    either may be little known where what they come to is known well.
    """
    adopted = derived_sizes(effect.name, effect.params, scene)
    if effect.posterior is None or not adopted:
        return adopted
    units = {name: unit for name, (_, unit, _) in effect.params.items()}
    likely = _derived_likely(effect.name, effect.posterior, units, scene)
    found: dict[str, Estimate] = {}
    for name, (value, unit, _) in adopted.items():
        at, _, (low, high) = likely[name]
        off = abs(value - at)
        found[name] = (value, unit, (value - (at - low) - off, value + (high - at) + off))
    return found


def _derived_likely(name: str, posterior: Posterior, units: dict[str, str], scene: Scene) -> dict[str, Estimate]:
    """The same of the most likely parameters."""
    deviations = np.sqrt(np.maximum(np.diag(posterior.covariance), 0.0))
    around: dict[str, Estimate] = {}
    for (p, value), deviation in zip(posterior.params.items(), deviations.tolist(), strict=True):
        half = TWO_SIDED_95 * deviation
        around[p] = (value, units[p], (value - half, value + half))
    return derived_sizes(name, around, scene, _correlation(posterior.covariance, deviations))


def _correlation(covariance: Samples, deviations: Samples) -> Samples:
    told = np.where(deviations > 0, deviations, 1.0)
    return np.asarray(covariance / np.outer(told, told))
