"""A Smith predictor with a robust H-infinity controller, after Tsai and Chen 2003 ([6] in Xu and Li 2010).

Taken from their title and from what Xu and Li say of it: the stage as a gain and a time delay that both vary, a Smith
predictor for the nominal ones, and a controller made robust against their ranges. The ranges are those of the recorded
sines; beyond their frequencies the measured response stands for the stage, with its modes 10 % up and down, as our own
loops are made for.

With the predictor in the loop, T = F exp(-s tau) for the delay-free loop F (Morari and Zafiriou 1989, Robust Process
Control, section 6.2). F is 1/(1 + s/w)^n, with or without a notch at the first mode. Of these and of n = 1 to 6 and w,
those are taken that reach the highest w_b with |w_b/s (1 - F exp(-s tau))| + |W F| <= 1 at all frequencies, W the
largest relative error of the nominal stage: robust performance in the norm of H-infinity (Skogestad and Postlethwaite
2005, eq. 7.61), over a family instead of all controllers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import bilinear

from rivals.bench import Reference
from rivals.evidence import TICK_S, Evidence, Samples
from rivals.paths import Path

SHIFT = 0.1
ORDERS = range(1, 7)
CORNERS_Hz = np.geomspace(1.0, 500.0, 80)


NOTCHES = (None, 0.05, 0.1, 0.2, 0.4)
"""Damping of the zeros at the first mode; the poles there have 1. None: no notch."""


@dataclass(frozen=True)
class Shape:
    """F: corner and order of its lags, and the notch (Hz, damping of the zeros) if it has one."""

    corner_Hz: float
    order: int
    notch: tuple[float, float] | None = None

    def response(self, f_Hz: Samples) -> np.ndarray:
        """F, (m,)."""
        found = 1 / (1 + 1j * f_Hz / self.corner_Hz) ** self.order
        if self.notch is not None:
            s = 1j * f_Hz / self.notch[0]
            found = found * (s**2 + 2 * self.notch[1] * s + 1) / (s + 1) ** 2
        return np.asarray(found)

    def section(self) -> tuple[Samples, Samples]:
        """The notch at the ticks, b and a (3,): the bilinear transform that is right at its frequency."""
        if self.notch is None:
            return np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
        w = 2 / TICK_S * np.tan(np.pi * self.notch[0] * TICK_S)
        b, a = bilinear([1 / w**2, 2 * self.notch[1] / w, 1], [1 / w**2, 2 / w, 1], 1 / TICK_S)
        return np.asarray(b), np.asarray(a)


class SmithPredictor:
    """F behind the difference of path and what the model cannot explain."""

    def __init__(self, evidence: Evidence, path: Path, reference: Reference) -> None:
        self._wanted_um = reference.by_tick()
        self._loop = PredictedLoop(*nominal(evidence), designed(evidence), limits_V=evidence.u_limits_V)

    def step(self, tick: int, measured_um: float) -> float:
        return self._loop.step(self._wanted_um(tick), measured_um)


class PredictedLoop:
    """The Smith predictor itself, tick by tick: gain in um/V and dead time of the model, and F."""

    def __init__(
        self, gain: float, dead_s: float, shape: Shape, *, limits_V: tuple[float, float] = (-1e9, 1e9)
    ) -> None:
        self._gain, self._limits_V = gain, limits_V
        self._dead_ticks = dead_s / TICK_S
        self._pole = float(np.exp(-2 * np.pi * shape.corner_Hz * TICK_S))
        self._lags_um = [0.0] * shape.order
        self._b, self._a = (list(map(float, row)) for row in shape.section())
        self._kept = [0.0, 0.0]
        self._given_V = [0.0] * (int(self._dead_ticks) + 3)

    def step(self, wanted_um: float, measured_um: float) -> float:
        """Volts for this tick."""
        whole = int(self._dead_ticks)
        part = self._dead_ticks - whole
        # What was given `dead_ticks` ago; the voltage of this tick is not known yet and has not arrived either.
        model_um = self._gain * ((1 - part) * self._given_V[-whole] + part * self._given_V[-whole - 1])
        value = wanted_um - (measured_um - model_um)
        for i in range(len(self._lags_um)):
            self._lags_um[i] = value = self._pole * self._lags_um[i] + (1 - self._pole) * value
        value = self._notched(value)
        given = min(max(value / self._gain, self._limits_V[0]), self._limits_V[1])
        self._given_V = [*self._given_V[1:], given]
        return float(given)

    def _notched(self, value: float) -> float:
        (b0, b1, b2), (_, a1, a2), (one, other) = self._b, self._a, self._kept
        found = b0 * value + one
        self._kept = [b1 * value - a1 * found + other, b2 * value - a2 * found]
        return found


def nominal(evidence: Evidence) -> tuple[float, float]:
    """Middle of the gains that were met, um/V, and the delay of the response far below the first mode, at least one
    tick."""
    low, high = gain_range(evidence)
    slow = (evidence.f_Hz > 0.1 * evidence.first_mode_Hz) & (evidence.f_Hz < 0.3 * evidence.first_mode_Hz)
    phase = np.angle(evidence.gain[slow])
    delay_s = float(-(phase @ evidence.f_Hz[slow]) / (evidence.f_Hz[slow] @ evidence.f_Hz[slow]) / (2 * np.pi))
    return float(np.sqrt(low * high)), max(delay_s, TICK_S)


def gain_range(evidence: Evidence) -> tuple[float, float]:
    """Local gains, um/V: of small motions, and of the sines."""
    _, _, gains, _ = evidence.grid
    slow = evidence.f_Hz < 0.1 * evidence.first_mode_Hz
    small = float(np.median(np.abs(evidence.gain[slow])))
    return float(min(gains.min(), small)), float(max(gains.max(), small))


def relative_error(evidence: Evidence, f_Hz: Samples) -> Samples:
    """W: largest |P/P0 - 1| over the ranges, (m,)."""
    gain, dead_s = nominal(evidence)
    model = gain * np.exp(-2j * np.pi * f_Hz * dead_s)
    slow = evidence.f_Hz < 0.1 * evidence.first_mode_Hz
    small = float(np.median(np.abs(evidence.gain[slow])))
    worst = np.zeros(len(f_Hz))
    for shift in (1 - SHIFT, 1.0, 1 + SHIFT):
        moved = evidence.response_at(f_Hz / shift) / small
        for local in gain_range(evidence):
            worst = np.maximum(worst, np.abs(local * moved / model - 1))
    _, frequencies, gains, lags = evidence.grid
    for known in np.unique(frequencies):  # hysteresis lags at any frequency up to that of the record
        own = frequencies == known
        errors = np.abs(gains[own] * np.exp(-1j * lags[own]) / (gain * np.exp(-2j * np.pi * known * dead_s)) - 1)
        worst = np.where(f_Hz <= known, np.maximum(worst, errors.max()), worst)
    return worst


def designed(evidence: Evidence) -> Shape:
    """F with the fastest |1 - F exp(-s tau)| that is robust."""
    f_Hz = np.geomspace(0.2, evidence.f_Hz[-1], 1000)
    error, (_, dead_s) = relative_error(evidence, f_Hz), nominal(evidence)
    late, w = np.exp(-2j * np.pi * f_Hz * dead_s), 2 * np.pi * f_Hz
    best, reached = Shape(float(CORNERS_Hz[0]), 1), 0.0
    for zeta in NOTCHES:
        notch = None if zeta is None else (evidence.first_mode_Hz, zeta)
        for order in ORDERS:
            for corner_Hz in CORNERS_Hz:
                tried = Shape(float(corner_Hz), order, notch)
                loop = tried.response(f_Hz)
                room = 1 - np.abs(error * loop)
                if (room <= 0).any():
                    break
                own = float((room * w / np.abs(1 - loop * late)).min())
                if own > reached:
                    best, reached = tried, own
    return best
