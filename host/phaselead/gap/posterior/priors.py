"""What is known of sizes and shapes before the records are looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb, log

import numpy as np
from scipy.special import gammaln
from scipy.stats import t as t_distribution

from phaselead.gap.error_rates import INSIDE
from phaselead.gap.parameters import SizedEffect, is_logarithmic, to_internal
from phaselead.model import Parameter
from phaselead.record import Samples

SIZES = np.array([0.06, 0.25, 1.0, 2.5])
"""Deviations of sizes in typical values, all as likely: the literature's sizes of one effect span two decades."""
LARGEST = float(SIZES[-1])
"""Deviation of a size of which nothing is known."""
KNOWN_BEFORE = LARGEST * float(t_distribution.isf((1 - INSIDE) * len(SIZES) / 2, 1))
"""Size in typical values that 95 of 100 stay below: no record is needed to know that. So far out only the last of
``SIZES`` has any probability, and it is one of as many as there are."""
SHAPE_SPREAD = 1.2
"""Deviation of the logarithm of a shape about its typical value: a factor of 3 either way."""
FLEXURE_ZETA, ZETA_SPREAD = 0.02, 0.7
"""Damping of flexure stages and the deviation of its logarithm: 0.005 to 0.08 in 95 of 100 (data sheets)."""


@dataclass(frozen=True)
class Prior:
    """The prior density at some parameters, and the normal distribution that is like it there."""

    log_density: float
    precision: Samples
    """(parameters,) in internal units, as ``internal`` gives them."""
    centre: Samples
    """(parameters,)"""


def prior_of(entries: Sequence[SizedEffect]) -> Prior:
    """The prior of all parameters of some effects."""
    total = 0.0
    precision: list[float] = []
    centre: list[float] = []
    for effect, params in entries:
        sizes = np.array([to_internal(p, params[p.name]) for p in effect.sizes])
        one_sided = sum(log(2.0) for p in effect.sizes if p.low >= 0)
        logs, precisions = _of_sizes(sizes)
        weights = np.exp(logs - logs.max())
        total += float(logs.max() + np.log(weights.mean())) + one_sided
        size_precision = float((weights * precisions).sum() / weights.sum())
        for p in effect.parameters:
            if p.role == "size":
                precision.append(size_precision)
                centre.append(0.0)
                continue
            middle, spread = _shape_prior(p, effect.peak)
            off = (to_internal(p, params[p.name]) - middle) / spread
            total += -0.5 * off**2 - log(spread * np.sqrt(2 * np.pi))
            precision.append(1 / spread**2)
            centre.append(middle)
    return Prior(total, np.array(precision), np.array(centre))


def _of_sizes(sizes: Samples) -> tuple[Samples, Samples]:
    """Log density of sizes (n,) in typical values under each of ``SIZES``, and the precision there of the normal
    distribution that is like it. The last has the tails of Student's t with one degree of freedom: some stage somewhere
    has twenty typical sizes."""
    n, square = len(sizes), float(sizes @ sizes)
    logs = -0.5 * square / SIZES**2 - n * np.log(SIZES * np.sqrt(2 * np.pi))
    precisions = 1 / SIZES**2
    logs[-1] = gammaln((1 + n) / 2) - gammaln(0.5) - n * log(LARGEST * np.sqrt(np.pi))
    logs[-1] -= (1 + n) / 2 * np.log1p(square / LARGEST**2)
    precisions[-1] = (1 + n) / (LARGEST**2 + square)
    return logs, precisions


def _shape_prior(p: Parameter, peak: tuple[str, str] | None) -> tuple[float, float]:
    """Centre and deviation of a shape in internal units."""
    if peak is not None and p.name == peak[1]:
        return log(FLEXURE_ZETA), ZETA_SPREAD
    low, high = to_internal(p, p.low), to_internal(p, p.high)
    uniform = (high - low) / np.sqrt(12)
    if p.unit == "Hz" or p.between_forms:
        return (low + high) / 2, uniform
    if is_logarithmic(p):
        return log(p.typical), min(SHAPE_SPREAD, uniform)
    return to_internal(p, p.typical), uniform


def log_prior_of_set(size: int, catalogue: int) -> float:
    """Of a set of so many effects out of a catalogue: every number of effects is as likely, and every set of that
    number (Scott and Berger 2010)."""
    return -log(catalogue + 1) - log(comb(catalogue, size))
