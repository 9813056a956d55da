"""How well a basis predicts data that it was not fitted to: levels, or stretches of time, are left out in turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phaselead.identify.operator.regressors import FitRun
from phaselead.identify.operator.solution import solve_slopes
from phaselead.identify.runs import distinct
from phaselead.record import Samples

FOLD_BLOCKS = 6
"""Stretches of time into which few records are split, to leave out one after the other."""
SIMPLER = 1.02
"""The simplest basis wins whose error on data left out is at most this times the least."""
BEYOND = 0.05
"""Share of all voltages by which a stretch of time must reach beyond all others to show what none of these do: as wide
as the finest segment."""


def folds_of(fits: list[FitRun], *, extrapolating: bool = False) -> list[Samples]:
    """Groups to leave out together, (groups,) each: a level of drive, or a stretch of time when there are few levels.

    The highest level always stays, and so does a stretch that reaches beyond all others: what lies beyond all data is
    extrapolation, and no basis is to be judged by it. Where ``extrapolating`` is what the fit is for, stretches of time
    are all left out.
    """
    swings = [float(np.ptp(f.run.u_V[f.run.scored])) for f in fits]
    levels = distinct(swings)
    if len(fits) >= FOLD_BLOCKS and len(levels) >= 4:
        nearest = [int(np.argmin(np.abs(np.subtract(levels, s)))) for s in swings]
        return [np.equal(nearest, level) for level in range(len(levels) - 1)]
    within = ~_beyond_others(fits) | extrapolating
    folds = [within & (np.arange(len(within)) % FOLD_BLOCKS == fold) for fold in range(FOLD_BLOCKS)]
    return [fold for fold in folds if fold.any()]


def _beyond_others(fits: list[FitRun]) -> NDArray[np.bool_]:
    """Which groups (groups,) reach voltages that no other comes near."""
    found = [f.run.u_V[f.rows[of_group]] for f in fits for _, of_group in f.stretches]
    highest, lowest = np.array([u.max() for u in found]), np.array([u.min() for u in found])
    margin_V = BEYOND * (highest.max() - lowest.min())
    beyond = np.zeros(len(found), dtype=np.bool_)
    for ends in (highest, -lowest):
        top = int(np.argmax(ends))
        beyond[top] |= ends[top] > np.delete(ends, top).max(initial=-np.inf) + margin_V
    return beyond


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
