"""The table view from a measured grid: regression of Xu & Li 2010, eqs. 6-8, with covariances.

The measured points are far more exact than a polynomial of second degree is right, so a point's variance is
its own plus a lack of fit common to all points. The lack of fit is the one at which the weighted sum of
squares equals its degrees of freedom (Paule & Mandel 1982); the covariances therefore say how well the
*polynomial* is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from phaselead.errors import BadInput
from phaselead.model import XU_LI_2010, TablePoint, TableView
from phaselead.record import Samples

FEWEST_LEVELS = 3
FEWEST_FREQUENCIES = 3
SAME = 0.02
"""Levels or frequencies closer than this, relatively, are one."""
WORST_CONDITION = 1e6
NAMES = tuple(f"{letter}{i}" for letter, n in (("a", 3), ("b", 6), ("c", 6)) for i in range(n))
PER = ("", "/V", "/Hz", "/(V Hz)", "/V^2", "/Hz^2")
UNITS = ("um/V", "um/V^2", "um/V^3", *("deg" + per for per in PER), *("um" + per for per in PER))


@dataclass(frozen=True)
class Regression:
    """One surface: coefficients (k,), covariance (k, k), and the rms lack of fit in the unit of the data."""

    coefficients: Samples
    covariance: Samples
    lack_of_fit: float


def regress(X: Samples, y: Samples, std: Samples) -> Regression:
    """Weighted least squares of ``y`` (n,) on ``X`` (n, k); standard deviations ``std`` (n,), lack of fit on
    top.

    Raises BadInput when the columns cannot be told apart.
    """
    scale = np.abs(X).max(axis=0)
    if len(y) < X.shape[1] or np.linalg.cond(X / scale) > WORST_CONDITION:
        raise BadInput(
            f"the grid's {len(y)} points do not determine {X.shape[1]} coefficients; "
            "spread them over more levels and frequencies"
        )
    freedom = len(y) - X.shape[1]
    # A point without a standard deviation must not have infinite weight.
    own = np.square(np.maximum(std, 1e-9 * (np.abs(y).max() + 1e-300)))

    def solve(extra: float) -> tuple[Samples, Samples, float]:
        root = 1.0 / np.sqrt(own + extra)
        A = (X / scale) * root[:, None]
        inverse = np.linalg.inv(A.T @ A)
        coefficients = inverse @ (A.T @ (y * root))
        return (
            coefficients / scale,
            inverse / np.outer(scale, scale),
            float(np.sum((y * root - A @ coefficients) ** 2)),
        )

    extra = 0.0
    if freedom > 0 and solve(0.0)[2] > freedom:
        extra = float(brentq(lambda v: solve(v)[2] - freedom, 0.0, 10.0 * float(np.var(y)) + own.max()))
    coefficients, covariance, _ = solve(extra)
    return Regression(coefficients, covariance, float(np.sqrt(extra)))


def distinct(values: Sequence[float]) -> list[float]:
    """The values that differ by more than ``SAME``, ascending, each the mean of its neighbours."""
    groups: list[list[float]] = []
    for value in sorted(values):
        if groups and value <= groups[-1][0] * (1 + SAME):
            groups[-1].append(value)
        else:
            groups.append([value])
    return [float(np.mean(group)) for group in groups]


def regressors(swing_V: Samples, f_Hz: Samples) -> Samples:
    """Columns of eqs. 7 and 8, (n, 6); the first, second and fifth are those of eq. 6."""
    return np.stack([np.ones_like(f_Hz), swing_V, f_Hz, swing_V * f_Hz, swing_V**2, f_Hz**2], axis=1)


def table_fit(points: Sequence[TablePoint]) -> TableView:
    """Regress the table view on measured points. Raises BadInput when levels or frequencies are too few."""
    levels = distinct([p.swing_V for p in points])
    frequencies = distinct([p.f_Hz for p in points])
    if len(levels) < FEWEST_LEVELS or len(frequencies) < FEWEST_FREQUENCIES:
        raise BadInput(
            f"a table view needs at least {FEWEST_LEVELS} levels and {FEWEST_FREQUENCIES} frequencies, "
            f"not {len(levels)} and {len(frequencies)}; record more sines"
        )
    swing, f = _column(points, "swing_V"), _column(points, "f_Hz")
    X = regressors(swing, f)
    a = regress(X[:, [0, 1, 4]], _column(points, "gain_um_per_V"), _column(points, "gain_std"))
    b = regress(X, _column(points, "phase_deg"), _column(points, "phase_std"))
    c = regress(X, _column(points, "x0_um"), _column(points, "x0_std"))
    return TableView(
        swing_V=(_plain(levels[0]), _plain(levels[-1])),
        f_Hz=(_plain(frequencies[0]), _plain(frequencies[-1])),
        a_um_per_V=tuple(a.coefficients),
        b_deg=tuple(b.coefficients),
        c_um=tuple(c.coefficients),
        a_cov=_rows(a.covariance),
        b_cov=_rows(b.covariance),
        c_cov=_rows(c.covariance),
        points=tuple(sorted(points, key=lambda p: (p.swing_V, p.f_Hz))),
    )


def _column(points: Sequence[TablePoint], name: str) -> Samples:
    return np.array([getattr(point, name) for point in points], dtype=np.float64)


def _rows(matrix: NDArray[np.float64]) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(v) for v in row) for row in matrix)


def _plain(edge: float) -> float:
    """The edge as it was asked for: converter codes put 9.9997 V where 10 V was meant."""
    return float(f"{edge:.3g}")


@dataclass(frozen=True)
class Compared:
    """One coefficient of the paper's Table I beside ours; ``std`` is nan without a covariance."""

    name: str
    unit: str
    paper: float
    ours: float
    std: float


def beside_table_1(view: TableView) -> list[Compared]:
    """The paper's Table I beside ``view``, a0 ... c5."""
    paper = (*XU_LI_2010.a_um_per_V, *XU_LI_2010.b_deg, *XU_LI_2010.c_um)
    ours = (*view.a_um_per_V, *view.b_deg, *view.c_um)
    std: list[float] = []
    for cov, n in ((view.a_cov, 3), (view.b_cov, 6), (view.c_cov, 6)):
        std += [float("nan")] * n if cov is None else [float(np.sqrt(cov[i][i])) for i in range(n)]
    return [Compared(*row) for row in zip(NAMES, UNITS, paper, ours, std, strict=True)]


def comparison_text(view: TableView) -> str:
    """``beside_table_1`` as a table to read."""
    lines = [f"{'':4}{'Table I':>10}{'ours':>12}{'+- std':>11}  unit"]
    lines += [f"{r.name:4}{r.paper:10.4f}{r.ours:12.4f}{r.std:11.4f}  {r.unit}" for r in beside_table_1(view)]
    return "\n".join(lines)
