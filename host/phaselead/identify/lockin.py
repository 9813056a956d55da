"""Lock-in: gain, phase lag and offset of the answer to a sine, period by period (Xu & Li 2010, eqs. 4-5).

    u = A (1 - cos 2 pi f t),   x = K A (1 - cos(2 pi f t - theta)) + x0

Phases refer to the applied voltage, so the converter's own latency is part of theta, as it is when the stage
is driven.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from phaselead.errors import BadInput
from phaselead.identify.checks import FEWEST_PERIODS, AxisRun, Sine, sine_of
from phaselead.model import TablePoint
from phaselead.record import Samples

HARMONICS = 7
"""Fitted beside the fundamental, so that a loop's odd harmonics do not leak into it over inexact periods."""
STEADY = 0.01
"""Largest change between periods, as a share of the amplitude, that still counts as steady (creep: 0.2 %)."""
FEWEST_ROWS_PER_PERIOD = 2 * (HARMONICS + 1) + 4


@dataclass(frozen=True)
class LockIn:
    """One grid point. Standard deviations are of the means over ``periods`` periods."""

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
    rows = run_rows(run, sine) * periods
    white = noise_um * np.sqrt(2.0 / rows)
    floor = (white / amplitude.mean(), np.rad2deg(white / response.mean()), noise_um * np.sqrt(3.0 / rows))
    return LockIn(
        sine.f_Hz, float(2 * amplitude.mean()),
        float(gain.mean()), _std_of_mean(gain, floor[0]),
        float(np.rad2deg(lag.mean())), _std_of_mean(np.rad2deg(lag), floor[1]),
        float(x0.mean()), _std_of_mean(x0, floor[2]),
        periods, run.source,
    )  # fmt: skip


def run_rows(run: AxisRun, sine: Sine) -> float:
    """Rows per period."""
    return 1.0 / (sine.f_Hz * run.step_s)


def _std_of_mean(values: Samples, floor: float) -> float:
    """The larger of the scatter between periods and the sensor noise: few periods understate their
    scatter."""
    return max(float(values.std(ddof=1) / np.sqrt(len(values))), float(floor))


def _whole_periods(run: AxisRun, sine: Sine) -> list[slice]:
    """Rows of each usable period, counted back from the end."""
    rows = run_rows(run, sine)
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
    run: AxisRun, sine: Sine, periods: list[slice]
) -> tuple[tuple[np.ndarray[tuple[int, int], np.dtype[np.complex128]], ...], float]:
    """Fourier coefficients (period, order 0..HARMONICS) of u and x over steady periods; rms noise of x."""
    u, x, left = [], [], []
    for rows in periods:
        turn = 2 * np.pi * sine.f_Hz * (run.t_s[rows] - run.t_s[periods[0].start])
        angles = turn * np.arange(1, HARMONICS + 1)[:, None]
        basis = np.concatenate([np.ones((1, len(turn))), np.cos(angles), np.sin(angles)])
        both = np.stack([run.u_V[rows], run.x_um[rows]])
        fitted = np.linalg.solve(basis @ basis.T, basis @ both.T).T
        left.append(float(np.mean((both[1] - fitted[1] @ basis) ** 2)))
        waves = fitted[:, 1 : HARMONICS + 1] - 1j * fitted[:, HARMONICS + 1 :]
        u.append(np.concatenate([fitted[0, :1], waves[0]]))
        x.append(np.concatenate([fitted[1, :1], waves[1]]))
    u_all, x_all = np.array(u), np.array(x)
    change = np.linalg.norm(np.diff(x_all, axis=0), axis=1) / np.abs(x_all[1:, 1])
    noise_um = float(np.sqrt(np.mean(left)))
    # Each of the 2 HARMONICS + 1 coefficients scatters by noise sqrt(2/N); a difference by sqrt(2) more.
    scatter = noise_um * np.sqrt(4 * (2 * HARMONICS + 1) / run_rows(run, sine)) / np.abs(x_all[1:, 1])
    unsettled = np.flatnonzero(change > STEADY + 3 * scatter)
    first = int(unsettled[-1]) + 1 if len(unsettled) else 0
    if len(periods) - first < FEWEST_PERIODS:
        raise BadInput(
            f"{run.source}: no steady state, the last periods still differ by {100 * change[-1]:.1f} %; "
            "let the stage settle for more periods"
        )
    return (u_all[first:], x_all[first:]), noise_um
