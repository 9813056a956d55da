"""Of all parameters that the posterior allows, those that predict best.

The posterior knows that no equation is exact and allows what an exact one would not. So its most likely parameters
explain the records together with what the equation misses; a model that is to predict has the equation alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from phaselead.gap.refit import SizedEffect, bounded, fresh_columns, from_internal, internal, parameters_of
from phaselead.gap.residual import ModelledRun
from phaselead.model import Parameter
from phaselead.record import Samples

INSIDE = 0.95
"""Probability of the region of the posterior in which parameters may lie."""
EVALUATIONS = 12
"""Of the records, at most."""


def best_predicting(
    entries: Sequence[SizedEffect], covariance: Samples, runs: Sequence[ModelledRun]
) -> tuple[SizedEffect, ...]:
    """The parameters that leave least of some runs, in um about each one's mean, among those that lie within the region
    of 95 % about ``entries``.

    ``covariance`` is (parameters, parameters) in internal units.
    """
    free, start = parameters_of(entries), internal(entries)
    if not len(start):
        return tuple(entries)

    def errors(x: Samples) -> Samples:
        at = _entries_at(entries, free, x)
        return np.concatenate([_about_mean(run.error(at)[:, None])[:, 0] for run in runs])

    def slopes(x: Samples) -> Samples:
        at = _entries_at(entries, free, x)
        return -np.concatenate([_about_mean(fresh_columns(run, at, free)[:, :-1]) for run in runs])

    found = least_squares(errors, start, slopes, method="trf", x_scale="jac", max_nfev=EVALUATIONS).x
    off = found - start
    distance2 = float(off @ np.linalg.solve(covariance, off))
    inside = min(1.0, float(np.sqrt(chi2.ppf(INSIDE, len(start)) / max(distance2, 1e-12))))
    moved = start + inside * off
    better = float(np.sum(errors(moved) ** 2)) < float(np.sum(errors(start) ** 2))
    return _entries_at(entries, free, moved if better else start)


def _entries_at(
    entries: Sequence[SizedEffect], free: Sequence[tuple[int, Parameter]], x: Samples
) -> tuple[SizedEffect, ...]:
    moved = [(effect, dict(params)) for effect, params in entries]
    for (i, p), value in zip(free, x, strict=True):
        moved[i][1][p.name] = from_internal(p, float(value))
    return tuple((effect, bounded(effect, params)) for effect, params in moved)


def _about_mean(columns: Samples) -> Samples:
    return np.asarray(columns - columns.mean(axis=0))
