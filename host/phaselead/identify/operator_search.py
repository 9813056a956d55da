"""The delay and the memory at rest with which plays and segments explain records best."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from phaselead.identify.operator_design import Basis, FitRun, centred, linearised, moments_of
from phaselead.identify.operator_solve import RIDGE, Solved, solved_at
from phaselead.record import Samples

GUESS_STRIDE = 4
"""Of the rows, for the first guess."""
MOST_STEPS, STEP_SHARES, GAINED = 10, (1.0, 0.5, 0.2, 0.05), 1e-5
"""Steps, shares of a step that are tried until one gains, and the least relative gain."""
DELAY_STEP = 0.3
"""Of a row, for the slope of the error over the delay: voltages run straight between rows, and the error has a kink at
every row that a smaller step takes for a minimum."""
DAMPING = 0.01
"""Of the squared error: what a step across the whole range must gain. Settled rows do not know the memory at rest."""

UNFELT = 1e-12
"""Of the squared error: a move that changes the answer by less is rounding."""


@dataclass(frozen=True)
class Searched:
    """Where the search ended, and the relative rms error there."""

    delay_s: float
    rest_fraction: float
    error: float


def least_error(
    fits: list[FitRun], basis: Basis, bound: float, own_offsets: bool, start: tuple[float, float]
) -> Searched:
    """The least error from ``start`` (delay in s, rest fraction), by Gauss-Newton without the slopes (Kaufman 1975).

    ``bound`` is the longest delay in s. A start with a rest fraction of 0 knows nothing of the memory: others are tried
    first.
    """
    at = _first_guess(fits, basis, bound, own_offsets, start)
    solved = solved_at(fits, basis, *at, own_offsets)
    for _ in range(MOST_STEPS):
        move = _gauss_newton(fits, basis, at, solved, bound, own_offsets)
        for share in STEP_SHARES:
            tried = max(at[0] + share * move[0], 0.0), at[1] + share * move[1]
            better = solved_at(fits, basis, *tried, own_offsets)
            if better.error < (1 - GAINED) * solved.error:
                break
        else:
            break
        at, solved = tried, better
    return Searched(*at, solved.error)


def _first_guess(
    fits: list[FitRun], basis: Basis, bound: float, own_offsets: bool, start: tuple[float, float]
) -> tuple[float, float]:
    """The start or, where that knows nothing of the memory, the best of it and a grid on a part of the rows."""
    if start[1] != 0.0:
        return start
    few = [replace(f, rows=f.rows[::GUESS_STRIDE], groups=f.groups[::GUESS_STRIDE]) for f in fits]
    grid = [(bound * d, rest) for d, rest in product((0.0, 0.1, 0.3, 0.6), (-0.4, 0.0, 0.4, 0.8))]
    return min([start, *grid], key=lambda at: solved_at(few, basis, at[0], at[1], own_offsets).error)


def _gauss_newton(
    fits: list[FitRun], basis: Basis, at: tuple[float, float], solved: Solved, bound: float, own_offsets: bool
) -> tuple[float, float]:
    """Change of delay and rest fraction for the least error of the linearised model, inside their bounds."""
    step = DELAY_STEP * min(f.run.step_s for f in fits)
    size = int(np.count_nonzero(solved.slopes > 0)) + 4
    moments = moments_of(fits, (linearised(f, basis, *at, solved.slopes, step) for f in fits), size)
    total = centred(moments).sum(axis=0) if own_offsets else centred(moments.sum(axis=0))
    unit = np.array([bound, 1.0])
    total[-4:-2] *= unit[:, None]
    total[:, -4:-2] *= unit
    n = size - 4
    inner = total[:n, :n] + RIDGE * np.trace(total[:n, :n]) / max(n, 1) * np.eye(n)
    rest = total[n:, n:] - total[n:, :n] @ np.linalg.solve(inner, total[:n, n:])
    curvature = rest[:2, :2] + DAMPING * solved.error**2 * np.eye(2)
    place = np.array([at[0] / bound, at[1]])
    move = least_in_box(curvature, rest[:2, 3], np.array([0.0, -1.0]) - place, 1.0 - place)
    changes = np.diag(rest)[:2] * move**2 > UNFELT * solved.error**2
    return float(changes[0] * move[0] * bound), float(changes[1] * move[1])


def least_in_box(curvature: Samples, slope: Samples, low: Samples, high: Samples) -> Samples:
    """The least of x' curvature x / 2 - slope' x for low <= x <= high, all (2,): inside, or on an edge."""
    inside = np.linalg.solve(curvature, slope)
    if np.all((low <= inside) & (inside <= high)):
        return np.asarray(inside)
    tried = []
    for fixed, free in ((0, 1), (1, 0)):
        for value in (low[fixed], high[fixed]):
            x = np.empty(2)
            best = (slope[free] - curvature[free, fixed] * value) / curvature[free, free]
            x[fixed], x[free] = value, np.clip(best, low[free], high[free])
            tried.append(x)
    return min(tried, key=lambda x: float(x @ curvature @ x / 2 - slope @ x))
