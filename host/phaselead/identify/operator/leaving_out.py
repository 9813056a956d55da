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


def folds_of(fits: list[FitRun], *, leave_out_ends: bool = False) -> list[Samples]:
    """Groups to leave out together, (groups,) each: a level of drive, or a stretch of time when there are few levels.
    Three groups at least.

    The highest level always stays, and of each fold so do stretches that reach beyond all that is not in it: what lies
    beyond all data is extrapolation, and no basis is to be judged by it. With ``leave_out_ends`` such stretches are
    left out too: to judge what the fit of a part of the rows says of others.
    """
    swings = [float(np.ptp(f.run.u_V[f.run.scored])) for f in fits]
    levels = distinct(swings)
    if len(fits) >= FOLD_BLOCKS and len(levels) >= 4:
        nearest = [int(np.argmin(np.abs(np.subtract(levels, s)))) for s in swings]
        return [np.equal(nearest, level) for level in range(len(levels) - 1)]
    ends_V = _ends_V(fits)
    folds = [np.arange(len(ends_V)) % FOLD_BLOCKS == fold for fold in range(FOLD_BLOCKS)]
    if not leave_out_ends:
        folds = [fold & ~_beyond_others(ends_V, fold) for fold in folds]
    return [fold for fold in folds if fold.any()]


def _ends_V(fits: list[FitRun]) -> Samples:
    """Lowest and highest voltage (groups, 2) of every group."""
    found = [f.run.u_V[f.rows[of_group]] for f in fits for _, of_group in f.stretches]
    return np.array([(u.min(), u.max()) for u in found])


def _beyond_others(ends_V: Samples, fold: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which groups (groups,) reach voltages that none outside a fold comes near."""
    lowest, highest = ends_V.T
    margin_V = BEYOND * (highest.max() - lowest.min())
    others_from_V, others_to_V = lowest[~fold].min(initial=np.inf), highest[~fold].max(initial=-np.inf)
    return np.asarray((lowest < others_from_V - margin_V) | (highest > others_to_V + margin_V))


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
