"""95 % intervals of parameters: from the covariance of the posterior, widened by how far the adopted values lie from
its most likely ones, and ending where the range of the catalogue ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.gap.findings import TWO_SIDED_95, Estimate
from phaselead.gap.parameters import SizedEffect, from_internal, parameters_of, to_internal
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.model import Effect
from phaselead.record import Samples


def intervals(
    entries: Sequence[SizedEffect], covariance: Samples, chosen: Sequence[SizedEffect] | None = None
) -> list[dict[str, Estimate]]:
    """Value, unit and interval of every parameter of every effect, from the covariance (parameters, parameters) in
    internal units about ``entries``. An interval ends where the catalogue does. The values are those of ``chosen``, by
    default the same; by how much two ways to weigh the same records differ, either may be off to either side."""
    values = entries if chosen is None else chosen
    found: list[dict[str, Estimate]] = [{} for _ in entries]
    for (i, p), variance in zip(parameters_of(entries), np.diag(covariance), strict=True):
        value, half = float(values[i][1][p.name]), TWO_SIDED_95 * float(np.sqrt(max(variance, 0.0)))
        middle = to_internal(p, float(entries[i][1][p.name]))
        at = to_internal(p, value)
        reach = half + abs(at - middle)
        low, high = sorted(from_internal(p, at + side * reach) for side in (-1, 1))
        found[i][p.name] = (value, p.unit, (min(low, value), max(high, value)))
    return found


def intervals_alone(likelihood: Likelihood, entries: Sequence[SizedEffect]) -> list[dict[str, Estimate]]:
    """``intervals`` of effects that were fitted outside a contest."""
    return intervals(entries, likelihood.fit(entries, steps=0).covariance)


def shows_itself(effect: Effect, found: Mapping[str, Estimate]) -> bool:
    """Whether the interval of a size by which an effect bears its name is clear of nothing; an effect without sizes
    does."""
    sizes = [p for p in effect.sizes if not p.nameless]
    return not sizes or any(low > 0 or high < 0 for _, _, (low, high) in (found[p.name] for p in sizes))
