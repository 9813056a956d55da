"""A phase-lead compensator with a look-up table and a self-tuning regulator, after Yan, Chen and Yen 2007 ([7] in Xu
and Li 2010).

Taken from what Xu and Li say of it (the stage as a phase lag, a lead compensator, a table against rate dependence) and
its title; the regulator is that of Astrom and Wittenmark 1995, Adaptive Control, chapter 3, in its smallest form.

The table holds gain and lag of every recorded sine over swing and frequency; above the highest frequency it goes on
with the measured response. The compensator is 1 + h (1 - 1/z): one zero, whose lead at the path's frequency is exactly
the lag in the table. Recursive least squares with forgetting estimate gain and offset of the compensated stage, and
the regulator divides by the one and takes off the other.
"""

from __future__ import annotations

import numpy as np

from rivals.bench import Reference
from rivals.evidence import TICK_S, Evidence
from rivals.paths import Path

FORGOTTEN_PERIODS, SLOWEST_s = 2.0, 0.2
"""Memory of the estimates: so many periods of the path, and no shorter than this, which is many periods of a mode."""
MISFIT = 0.3
"""Of a sample, of the swing: what the model form leaves, a few per cent, over the samples that share it."""
GAINS = (0.5, 2.0)
"""What is believed of an estimate."""


class LeadLookUp:
    """Look-up, lead, and regulator."""

    def __init__(self, evidence: Evidence, path: Path, reference: Reference) -> None:
        self._wanted_um = reference.by_tick()
        gain, lag = looked_up(evidence, path.swing_um, path.f_Hz)
        self._h = lead_coefficient(lag, path.f_Hz)
        turn = np.exp(-2j * np.pi * path.f_Hz * TICK_S)
        self._V_per_um = 1 / (gain * abs(1 + self._h * (1 - turn)))
        self._kept = float(np.exp(-TICK_S / max(FORGOTTEN_PERIODS / path.f_Hz, SLOWEST_s)))
        self._asked_share: float | None = None
        self._before_um = 0.0
        self._swing_um = path.swing_um
        # Gain, and offset as a share of the swing; both may be off by a tenth at the begin.
        self._estimate = np.array([1.0, 0.0])
        self._information = np.eye(2) / 0.1**2

    def step(self, tick: int, measured_um: float) -> float:
        wanted = self._wanted_um(tick) / self._swing_um
        # The compensated stage has no lag at the path's frequency: now it is where it was asked to be in this tick.
        if self._asked_share is not None:
            self._learn(np.array([self._asked_share, 1.0]), measured_um / self._swing_um)
        gain, offset = self._estimate
        self._asked_share = (wanted - offset) / min(max(gain, GAINS[0]), GAINS[1])
        given_um = self._asked_share * self._swing_um
        compensated = given_um + self._h * (given_um - self._before_um)
        self._before_um = given_um
        return compensated * self._V_per_um

    def _learn(self, regressor: np.ndarray, measured: float) -> None:
        # Least squares by information: what is forgotten comes back as what was believed at the begin.
        believed = (1 - self._kept) * np.eye(2) / 0.1**2
        self._information = self._kept * self._information + believed + np.outer(regressor, regressor) / MISFIT**2
        change = regressor * (measured - regressor @ self._estimate) / MISFIT**2
        self._estimate = self._estimate + np.linalg.solve(self._information, change)


def lead_coefficient(lag: float, f_Hz: float) -> float:
    """h of 1 + h (1 - 1/z) whose phase at ``f_Hz`` is ``lag`` (rad, below a right angle)."""
    turn = 2 * np.pi * f_Hz * TICK_S
    slope = np.tan(min(lag, np.radians(85.0)))
    below = np.sin(turn) - slope * (1 - np.cos(turn))
    return float(slope / below) if below > 0 else float(10.0 / np.sin(turn))


def looked_up(evidence: Evidence, swing_um: float, f_Hz: float) -> tuple[float, float]:
    """Gain in um/V and lag in rad for a path, between the points of the grid by straight lines."""
    swings, frequencies, gains, lags = evidence.grid
    known_Hz = np.unique(frequencies)
    inside_Hz = float(np.clip(f_Hz, known_Hz[0], known_Hz[-1]))
    columns = []
    for known in known_Hz:
        own = np.flatnonzero(frequencies == known)
        own = own[np.argsort(swings[own])]
        reached = gains[own] * swings[own]
        columns.append([np.interp(swing_um, reached, values[own]) for values in (gains, lags)])
    gain, lag = (float(np.interp(inside_Hz, known_Hz, column)) for column in np.array(columns).T)
    beyond = evidence.response_at(f_Hz) / evidence.response_at(inside_Hz) if f_Hz > inside_Hz else 1.0
    return gain * float(np.abs(beyond)), lag - float(np.angle(beyond))
