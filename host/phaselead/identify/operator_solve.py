"""The best slopes of plays and segments at a given delay and memory: linear, with no negative coefficient."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from phaselead.errors import BadInput
from phaselead.identify.operator_design import Basis, FitRun, centred, gram
from phaselead.record import Samples

RIDGE = 1e-8
"""Of the mean diagonal: keeps neighbouring plays that the data cannot tell apart from dividing by zero."""
REVERSIBLE = 0.2
"""Least share of the mean slope that is without memory: a piezo at a turning point does not stand still, and
without the bound a lag that no delay explains would make it."""


@dataclass(frozen=True)
class Solved:
    """Slopes [segments, plays] in um/V, position at rest in um, relative rms error over the records."""

    slopes: Samples
    at_rest_um: float
    error: float


def solve(moments: Samples, n_segments: int, own_offsets: bool) -> Solved:
    """Bounded least squares from weighted moments (group, k, k); see ``operator_design.gram``."""
    total = moments.sum(axis=0)
    ones = total[:, -2]
    total = centred(moments).sum(axis=0) if own_offsets else centred(total)
    inner, right = total[:-2, :-2], total[:-2, -1]
    size = len(right)
    least = np.zeros(size)
    straight = float(inner[:n_segments, :n_segments].sum())
    least[:n_segments] = REVERSIBLE * max(float(right[:n_segments].sum()) / straight, 0.0) if straight > 0 else 0.0
    ridge = RIDGE * np.trace(inner) / size * np.eye(size)
    if not np.isfinite(total).all():
        raise BadInput("the fit is singular: voltage or position hardly move; record a larger swing")
    try:
        root = np.linalg.cholesky(inner + ridge)
        above, _ = nnls(root.T, np.linalg.solve(root, right - inner @ least), maxiter=50 * size)
    except (np.linalg.LinAlgError, RuntimeError):
        raise BadInput("the fit is singular; record a larger swing, over several levels") from None
    slopes = above + least
    left = float(total[-1, -1] - 2 * right @ slopes + slopes @ inner @ slopes)
    at_rest = float((ones[-1] - ones[:-2] @ slopes) / ones[-2])
    return Solved(slopes, at_rest, float(np.sqrt(max(left, 0.0))))


def solved_at(fits: list[FitRun], basis: Basis, delay_s: float, rest_fraction: float, own_offsets: bool) -> Solved:
    """The best slopes at a given delay and memory."""
    return solve(gram(fits, basis, delay_s, rest_fraction), len(basis.knots_V) - 1, own_offsets)
