"""Separable least squares: the Gauss-Newton search of the operator, of the common modes and of the gap's effects.

All three are linear in most of their parameters. Those are solved for at every point (variable projection, Golub &
Pereyra 1973; Kaufman 1975), and only the others are searched, by ``descend``.

``scipy.optimize.least_squares`` would want the residual and the Jacobian of every row of every record at once. Here a
point is judged by sums over rows, record after record, the linear parameters may have bounds, and the weights of the
records are estimated on the way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np
from scipy.optimize import lsq_linear

from phaselead.record import Samples

Point = TypeVar("Point")


def descend(
    start: Point,
    trials: Callable[[Point], Iterable[Point]],
    cost: Callable[[Point], float],
    most_steps: int,
    *,
    least_gain: float = 0.0,
    enough: float = 0.0,
    fewest_steps: int = 0,
    reweighed: Callable[[Point, int], Point] | None = None,
    report: Callable[[float], None] | None = None,
) -> Point:
    """The point at which no step lowers the cost any more.

    ``trials`` gives points away from one, ever more cautious; the first that lowers its cost by the share
    ``least_gain`` is gone on from, and when none does the search ends. So it does, after ``fewest_steps``, with a step
    that gained less than the share ``enough``. ``reweighed`` may replace the point before each step, by its number.
    """
    point = start
    for step in range(most_steps):
        if reweighed is not None:
            point = reweighed(point, step)
        before = cost(point)
        better = next((trial for trial in trials(point) if cost(trial) < (1 - least_gain) * before), None)
        if report is not None:
            report((step + 1) / most_steps)
        if better is None:
            break
        point = better
        if step + 1 >= fewest_steps and (before - cost(point)) / before < enough:
            break
    return point


def ridged(normal: Samples, share: float) -> Samples:
    """The normal matrix (k, k) with ``share`` of its mean diagonal added: it then has an inverse whatever the data."""
    return np.asarray(normal + share * np.trace(normal) / max(len(normal), 1) * np.eye(len(normal)))


def least_in_box(curvature: Samples, slope: Samples, low: Samples, high: Samples) -> Samples:
    """The x (k,) between ``low`` and ``high`` (k,) with the least x' ``curvature`` x / 2 - ``slope``' x.

    ``curvature`` (k, k) is symmetric and positive definite but for rounding.
    """
    free = np.linalg.solve(curvature, slope)
    if np.all((low <= free) & (free <= high)):
        return np.asarray(free)
    sizes, directions = np.linalg.eigh(curvature)
    number = np.finfo(np.float64)
    roots = np.sqrt(np.maximum(sizes, max(number.eps * sizes[-1], number.tiny)))
    matrix, target = roots[:, None] * directions.T, directions.T @ slope / roots
    found = lsq_linear(matrix, target, bounds=(low, high), method="bvls").x
    return np.asarray(np.clip(found, low, high))  # it ends outside by a rounding
