"""How well a basis predicts data that it was not fitted to: levels, or stretches of time, are left out in turn."""

from __future__ import annotations

import numpy as np

from phaselead.identify.operator.regressors import FitRun
from phaselead.identify.operator.solution import group_numbers, solve_slopes
from phaselead.identify.runs import distinct
from phaselead.record import Samples

FOLD_BLOCKS = 6
"""Stretches of time into which few records are split, to leave out one after the other."""
SIMPLER = 1.02
"""The simplest basis wins whose error on data left out is at most this times the least."""


def folds_of(fits: list[FitRun]) -> list[Samples]:
    """Groups to leave out together, (groups,) each: a level of drive, or a stretch of time when there are few levels.

    The highest level always stays: what lies beyond all data is extrapolation, and no basis is to be judged by it.
    """
    groups = len(group_numbers(fits))
    swings = [float(np.ptp(f.run.u_V[f.run.scored])) for f in fits]
    levels = distinct(swings)
    if len(fits) >= FOLD_BLOCKS and len(levels) >= 4:
        nearest = [int(np.argmin(np.abs(np.subtract(levels, s)))) for s in swings]
        return [np.equal(nearest, level) for level in range(len(levels) - 1)]
    return [np.arange(groups) % FOLD_BLOCKS == fold for fold in range(FOLD_BLOCKS)]


def left_out(of_groups: Samples, n_segments: int, folds: list[Samples]) -> float:
    """Relative rms error on the folds, each left out of the fit; moments (group, k, k) are centred."""
    total, squares, count = of_groups.sum(axis=0), 0.0, 0
    for fold in folds:
        out = of_groups[fold.astype(bool)].sum(axis=0)
        slopes, _, _ = solve_slopes((total - out)[None] + _unit_offset(total), n_segments, 1.0)
        inner, right = out[:-2, :-2], out[:-2, -1]
        squares += max(float(out[-1, -1] - 2 * right @ slopes + slopes @ inner @ slopes), 0.0)
        count += 1
    return float(np.sqrt(squares / count))


def _unit_offset(moments: Samples) -> Samples:
    """Centred moments carry no offset; a unit in its place keeps ``solve_slopes`` from dividing by zero."""
    unit = np.zeros_like(moments)
    unit[-2, -2] = 1.0
    return unit
