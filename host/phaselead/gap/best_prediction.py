"""Of all parameters that the posterior allows, those that predict best.

The posterior knows that no equation is exact and allows what an exact one would not. So its most likely parameters
explain the records together with what the equation misses; a model that is to predict has the equation alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.stats import chi2

from phaselead.gap.error_rates import INSIDE
from phaselead.gap.least_squares import fitted_in_um, squares_left
from phaselead.gap.parameters import SizedEffect, entries_at, internal
from phaselead.gap.residual import ModelledRun
from phaselead.record import Samples

EVALUATIONS = 12
"""Simulations of the records, at most."""


def best_predicting(
    entries: Sequence[SizedEffect],
    covariance: Samples,
    runs: Sequence[ModelledRun],
    levelled: Sequence[bool],
) -> tuple[SizedEffect, ...]:
    """The parameters that leave least of some runs, in um about each one's mean, among those that lie within the region
    of 95 % about ``entries``. Where an effect moves the zero, the runs whose levels say something, by ``levelled``,
    count about the mean of them all: where they stand says more of it than how far it moves within each.

    ``covariance`` is (parameters, parameters) in internal units.
    """
    start = internal(entries)
    if not len(start):
        return tuple(entries)
    moves_zero = any(effect.moves_zero is not None for effect, _ in entries)
    about_zero = partial(_about_zero, levelled if moves_zero else [False] * len(runs))
    found, _ = fitted_in_um(entries, runs, about_zero, EVALUATIONS)
    off = internal(found) - start
    distance2 = float(off @ np.linalg.solve(covariance, off))
    inside = min(1.0, float(np.sqrt(chi2.ppf(INSIDE, len(start)) / max(distance2, 1e-12))))
    at_start, moved = (entries_at(entries, x) for x in (start, start + inside * off))
    better = squares_left(moved, runs, about_zero) < squares_left(at_start, runs, about_zero)
    return moved if better else at_start


def _about_zero(of_one_zero: Sequence[bool], columns: Sequence[Samples]) -> Samples:
    """Columns (n_i, k) of each run about their mean in it, and of those that have one zero about that in all these; one
    behind the other (n, k)."""
    pairs = list(zip(columns, of_one_zero, strict=True))
    alike = [one for one, is_alike in pairs if is_alike]
    zero = np.concatenate(alike).mean(axis=0) if alike else 0.0
    return np.concatenate([one - (zero if is_alike else one.mean(axis=0)) for one, is_alike in pairs])
