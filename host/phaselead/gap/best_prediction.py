"""Of all parameters that the posterior allows, those that predict best.

The posterior knows that no equation is exact and allows what an exact one would not. So its most likely parameters
explain the records together with what the equation misses; a model that is to predict has the equation alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from phaselead.gap.error_rates import INSIDE
from phaselead.gap.least_squares import fitted_in_um, squares_left
from phaselead.gap.parameters import SizedEffect, entries_at, internal
from phaselead.gap.residual import ModelledRun
from phaselead.gap.zero import about_their_zero, standing_together
from phaselead.record import Samples

EVALUATIONS = 12
"""Simulations of the records, at most."""


def best_predicting(
    entries: Sequence[SizedEffect], covariance: Samples, runs: Sequence[ModelledRun], levelled: bool = False
) -> tuple[SizedEffect, ...]:
    """The parameters that leave least of some runs, in um about each one's mean, among those that lie within the region
    of 95 % about ``entries``. Where an effect moves the zero, driven runs that are ``levelled`` count about the mean of
    them all: where they stand says more of a zero that moves than how far it moves within each.

    ``covariance`` is (parameters, parameters) in internal units.
    """
    start = internal(entries)
    if not len(start):
        return tuple(entries)
    together = standing_together(entries, runs, levelled)

    def about_zero(columns: Sequence[Samples]) -> Samples:
        return np.concatenate(about_their_zero(columns, together))

    found, _ = fitted_in_um(entries, runs, about_zero, EVALUATIONS)
    off = internal(found) - start
    distance2 = float(off @ np.linalg.solve(covariance, off))
    inside = min(1.0, float(np.sqrt(chi2.ppf(INSIDE, len(start)) / max(distance2, 1e-12))))
    at_start, moved = (entries_at(entries, x) for x in (start, start + inside * off))
    better = squares_left(moved, runs, about_zero) < squares_left(at_start, runs, about_zero)
    return moved if better else at_start
