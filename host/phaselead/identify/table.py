"""The table view of a stage: lock-in of recorded sines, and regression over the grid (Xu & Li 2010, eqs. 4-8).

    u = A (1 - cos 2 pi f t),   x = K A (1 - cos(2 pi f t - theta)) + x0

Lock-in gives gain K, phase lag theta and offset x0 of each sine, period by period. Phases refer to the applied voltage,
so the converter's own latency is part of theta, as it is when the stage is driven.

Regression gives each of the three as a polynomial in swing and frequency. The points are far more exact than a
polynomial of second degree is right, so the variance of a point is its own plus a lack of fit common to all points: the
one at which the weighted sum of squares equals its degrees of freedom (Paule & Mandel 1982). The covariances therefore
say how well the *polynomial* is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from phaselead.errors import BadInput
from phaselead.identify.runs import FEWEST_PERIODS, AxisRun, SineDrive, distinct, sine_of
from phaselead.model import XU_LI_2010, TablePoint, TableView
from phaselead.record import Samples

LOCK_IN_HARMONICS = 7
"""Orders fitted with the fundamental: over inexact periods the odd harmonics of a loop would leak into it."""
STEADY = 0.01
"""Largest change from period to period, as a share of the amplitude, that counts as steady (creep: 0.2 %)."""
FEWEST_ROWS_PER_PERIOD = 2 * (LOCK_IN_HARMONICS + 1) + 4
FEWEST_LEVELS = 3
FEWEST_FREQUENCIES = 3
WORST_CONDITION = 1e6
NAMES = tuple(f"{letter}{i}" for letter, n in (("a", 3), ("b", 6), ("c", 6)) for i in range(n))
PER = ("", "/V", "/Hz", "/(V Hz)", "/V^2", "/Hz^2")
UNITS = ("um/V", "um/V^2", "um/V^3", *("deg" + per for per in PER), *("um" + per for per in PER))


@dataclass(frozen=True)
class LockIn:
    """Gain, phase lag and offset of one sine: means over ``periods`` periods, and their standard deviations."""

    f_Hz: float
    swing_V: float
    gain_um_per_V: float
    gain_std: float
    phase_deg: float
    phase_std: float
    x0_um: float
    x0_std: float
    periods: int
    source: str = ""

    def point(self) -> TablePoint:
        """As a stage file keeps it."""
        return TablePoint(
            swing_V=self.swing_V,
            f_Hz=self.f_Hz,
            gain_um_per_V=self.gain_um_per_V,
            gain_std=self.gain_std,
            phase_deg=self.phase_deg,
            phase_std=self.phase_std,
            x0_um=self.x0_um,
            x0_std=self.x0_std,
        )


def lock_in(run: AxisRun, f_Hz: float | None = None) -> LockIn:
    """Estimate one grid point from a recorded sine. ``f_Hz``: estimated from the voltage when not given.

    Rows before the window have settled the stage; without any, the first period is given to settling. Only
    whole periods are used. Raises BadInput: no sine, too few periods, not steady.
    """
    sine = run.sine if f_Hz is None else sine_of(run, f_Hz)
    if sine is None:
        raise BadInput(f"{run.source}: the voltage is no sine of one frequency; drive the grid with sines")
    spectra, noise_um = _steady_periods(run, sine, _whole_periods(run, sine))
    u, x = spectra
    amplitude, response = np.abs(u[:, 1]), np.abs(x[:, 1])
    gain = response / amplitude
    lag = np.angle(u[:, 1] / x[:, 1])
    middle = np.angle(np.mean(np.exp(1j * lag)))
    lag = middle + np.angle(np.exp(1j * (lag - middle)))
    x0 = x[:, 0].real - response
    periods = len(gain)
    # White noise of the sensor: variance 2 s^2/N of an amplitude over N rows, s^2/N of a mean.
    rows = rows_per_period(run, sine) * periods
    white = noise_um * np.sqrt(2.0 / rows)
    floor = (white / amplitude.mean(), np.rad2deg(white / response.mean()), noise_um * np.sqrt(3.0 / rows))
    return LockIn(
        sine.f_Hz, float(2 * amplitude.mean()),
        float(gain.mean()), _std_of_mean(gain, floor[0]),
        float(np.rad2deg(lag.mean())), _std_of_mean(np.rad2deg(lag), floor[1]),
        float(x0.mean()), _std_of_mean(x0, floor[2]),
        periods, run.source,
    )  # fmt: skip


def rows_per_period(run: AxisRun, sine: SineDrive) -> float:
    """Rows in one period of the sine; no whole number in general."""
    return 1.0 / (sine.f_Hz * run.step_s)


def _std_of_mean(values: Samples, floor: float) -> float:
    """The larger of the scatter between periods and the sensor noise: few periods understate their
    scatter."""
    return max(float(values.std(ddof=1) / np.sqrt(len(values))), float(floor))


def _whole_periods(run: AxisRun, sine: SineDrive) -> list[slice]:
    """Rows of each usable period, counted back from the end."""
    rows = rows_per_period(run, sine)
    if rows < FEWEST_ROWS_PER_PERIOD:
        raise BadInput(
            f"{run.source}: {rows:.1f} rows per period are too few; "
            f"sample at {FEWEST_ROWS_PER_PERIOD * sine.f_Hz:g} Hz or faster"
        )
    count = int((sine.rows.stop - sine.rows.start) / rows + 0.01)
    # Without settled rows ahead of the window the first period is the settling.
    settling = 0 if sine.rows.start - _first_move(run) > 0.9 * rows else 1
    if count - settling < FEWEST_PERIODS:
        raise BadInput(
            f"{run.source}: {count} whole periods of {sine.f_Hz:.4g} Hz are too few; "
            f"record at least {FEWEST_PERIODS + 1}"
        )
    edges = np.round(sine.rows.stop - rows * np.arange(count - settling, -1, -1)).astype(int)
    edges = np.maximum(edges, sine.rows.start)
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def _first_move(run: AxisRun) -> int:
    return int(np.flatnonzero(np.diff(run.u_V))[0])


def _steady_periods(
    run: AxisRun, sine: SineDrive, periods: list[slice]
) -> tuple[tuple[np.ndarray[tuple[int, int], np.dtype[np.complex128]], ...], float]:
    """Fourier coefficients (period, order 0..LOCK_IN_HARMONICS) of u and x over steady periods; rms noise of x."""
    u, x, squares = [], [], []
    for rows in periods:
        turn = 2 * np.pi * sine.f_Hz * (run.t_s[rows] - run.t_s[periods[0].start])
        angles = turn * np.arange(1, LOCK_IN_HARMONICS + 1)[:, None]
        basis = np.concatenate([np.ones((1, len(turn))), np.cos(angles), np.sin(angles)])
        both = np.stack([run.u_V[rows], run.x_um[rows]])
        fitted = np.linalg.solve(basis @ basis.T, basis @ both.T).T
        squares.append(float(np.mean((both[1] - fitted[1] @ basis) ** 2)))
        waves = fitted[:, 1 : LOCK_IN_HARMONICS + 1] - 1j * fitted[:, LOCK_IN_HARMONICS + 1 :]
        u.append(np.concatenate([fitted[0, :1], waves[0]]))
        x.append(np.concatenate([fitted[1, :1], waves[1]]))
    u_all, x_all = np.array(u), np.array(x)
    change = np.linalg.norm(np.diff(x_all, axis=0), axis=1) / np.abs(x_all[1:, 1])
    noise_um = float(np.sqrt(np.mean(squares)))
    # Each of the 2 LOCK_IN_HARMONICS + 1 coefficients scatters by noise sqrt(2/N); a difference by sqrt(2) more.
    scatter = noise_um * np.sqrt(4 * (2 * LOCK_IN_HARMONICS + 1) / rows_per_period(run, sine)) / np.abs(x_all[1:, 1])
    unsettled = np.flatnonzero(change > STEADY + 3 * scatter)
    first = int(unsettled[-1]) + 1 if len(unsettled) else 0
    if len(periods) - first < FEWEST_PERIODS:
        raise BadInput(
            f"{run.source}: no steady state, the last periods still differ by {100 * change[-1]:.1f} %; "
            "let the stage settle for more periods"
        )
    return (u_all[first:], x_all[first:]), noise_um


@dataclass(frozen=True)
class Regression:
    """One polynomial: coefficients (k,), covariance (k, k), and the rms lack of fit in the unit of the data."""

    coefficients: Samples
    covariance: Samples
    lack_of_fit: float


def regress(X: Samples, y: Samples, std: Samples) -> Regression:
    """Weighted least squares of ``y`` (n,) on ``X`` (n, k).

    A row has the variance ``std`` (n,) squared plus a lack of fit common to all. Raises BadInput when the columns
    cannot be told apart.
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


def regressors(swing_V: Samples, f_Hz: Samples) -> Samples:
    """Columns (n, 6) of eqs. 7 and 8; the first, second and fifth are those of eq. 6."""
    return np.stack([np.ones_like(f_Hz), swing_V, f_Hz, swing_V * f_Hz, swing_V**2, f_Hz**2], axis=1)


def table_fit(points: Sequence[TablePoint]) -> TableView:
    """Regress the table view on measured points. Raises BadInput when levels or frequencies are too few."""
    levels = distinct([p.swing_V for p in points])
    frequencies = distinct([p.f_Hz for p in points])
    if len(levels) < FEWEST_LEVELS or len(frequencies) < FEWEST_FREQUENCIES:
        raise BadInput(
            f"a table view needs sines of at least {FEWEST_LEVELS} levels and of {FEWEST_FREQUENCIES} frequencies, "
            f"and there are {len(levels)} and {len(frequencies)}; record more sines"
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
    """An edge of the grid to three digits: converter codes put 9.9997 V where 10 V was meant."""
    return float(f"{edge:.3g}")


@dataclass(frozen=True)
class Compared:
    """One coefficient in Table I of the paper and in a table view; ``std`` is nan without a covariance."""

    name: str
    unit: str
    paper: float
    ours: float
    std: float


def compare_with_table_1(view: TableView) -> list[Compared]:
    """Each coefficient a0 ... c5 of Table I in Xu & Li 2010 with that of ``view``."""
    paper = (*XU_LI_2010.a_um_per_V, *XU_LI_2010.b_deg, *XU_LI_2010.c_um)
    ours = (*view.a_um_per_V, *view.b_deg, *view.c_um)
    std: list[float] = []
    for cov, n in ((view.a_cov, 3), (view.b_cov, 6), (view.c_cov, 6)):
        std += [float("nan")] * n if cov is None else [float(np.sqrt(cov[i][i])) for i in range(n)]
    return [Compared(*row) for row in zip(NAMES, UNITS, paper, ours, std, strict=True)]


def comparison_text(view: TableView) -> str:
    """``compare_with_table_1`` as lines of text."""
    lines = [f"{'':4}{'Table I':>10}{'ours':>12}{'+- std':>11}  unit"]
    lines += [f"{r.name:4}{r.paper:10.4f}{r.ours:12.4f}{r.std:11.4f}  {r.unit}" for r in compare_with_table_1(view)]
    return "\n".join(lines)
