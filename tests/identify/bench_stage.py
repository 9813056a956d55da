"""A piezo stage for the tests of identification, written apart from the product's model and simulator.

Its hysteresis is a Python loop over turning points of nothing but max and min, its dynamics are scipy's. The
numbers are those of the built-in stage (one axis), so that a fit has something real to fight with:
remanence, asymmetry, creep, a lightly damped mode, latency and noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from phaselead.record.recording import AxisRecord, Recording

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BenchStage:
    gain: float = 14.284
    r: tuple[float, ...] = (0.05, 0.15, 0.3, 0.5, 0.8, 1.2, 1.7, 2.3, 3.0, 4.0)
    w: tuple[float, ...] = (1.982, 0.453, 1.072, 0.0, 2.305, 1.008, 1.058, 2.231, 0.549, 0.0)
    d: tuple[float, ...] = (1.0, 2.0, 3.0, 4.5, 6.0, 8.0)
    s: tuple[float, ...] = (1.650, 0.249, 1.563, -0.676, -1.410, -2.497)
    rest: float = 0.55
    creep: tuple[tuple[float, float], ...] = ((0.004, 0.1), (0.006, 1.0), (0.008, 10.0))
    mode_Hz: float = 200.0
    zeta: float = 0.02
    delay_ticks: int = 1
    noise_um: float = 0.01
    offset_um: float = 0.0

    def static(self, u: Array, backlash: Array | None = None) -> tuple[Array, Array]:
        """Hysteresis alone, zero at rest: (x, slack positions at the end)."""
        r = np.array(self.r)
        slack = self.rest * r if backlash is None else backlash.copy()
        track = np.empty((len(u), len(r)))
        for k, volt in enumerate(u):
            slack = np.clip(slack, volt - r, volt + r)
            track[k] = slack
        x = self.gain * u + (track - self.rest * r) @ np.array(self.w)
        for knee, slope in zip(self.d, self.s, strict=True):
            x += slope * np.where(u > knee, u - knee, 0.0)
        return x, slack

    def quiet(self) -> BenchStage:
        """The same hysteresis with nothing behind it."""
        return replace(self, creep=(), mode_Hz=0.0, delay_ticks=0, noise_um=0.0)

    def measure(self, u: Array, rate_Hz: float, seed: int = 0, period: int = 0) -> Array:
        """Sensor reading for a voltage held between samples, from rest. ``period``: u repeats after so many
        samples."""
        if period and len(u) > 3 * period:
            two, _ = self.static(u[: 2 * period])
            x = np.concatenate([two[:period], np.resize(two[period:], len(u) - period)])
        else:
            x, _ = self.static(u)
        settled = x.copy()
        for share, tau in self.creep:
            pole = np.exp(-1.0 / (tau * rate_Hz))
            settled += share * lfilter([0.0, 1.0 - pole], [1.0, -pole], x)
        if self.mode_Hz:
            wn = 2 * np.pi * self.mode_Hz
            num, den, _ = cont2discrete(([wn * wn], [1.0, 2 * self.zeta * wn, wn * wn]), 1.0 / rate_Hz)
            settled = lfilter(num[0], den, settled)
        if self.delay_ticks:
            settled = np.concatenate([np.zeros(self.delay_ticks), settled[: -self.delay_ticks]])
        noise = np.random.default_rng(seed).normal(0.0, self.noise_um, len(u)) if self.noise_um else 0.0
        return np.asarray(settled + noise + self.offset_um)


def rising_sine(swing_V: float, f_Hz: float, periods: float, rate_Hz: float) -> tuple[Array, Array]:
    """The paper's eq. 4: from 0 to ``swing_V`` and back."""
    t = np.arange(round(periods * rate_Hz / f_Hz)) / rate_Hz
    return t, 0.5 * swing_V * (1.0 - np.cos(2 * np.pi * f_Hz * t))


def sine_record(
    stage: BenchStage,
    swing_V: float,
    f_Hz: float,
    periods: int = 5,
    rate_Hz: float = 5000.0,
    settle: int = 0,
    seed: int = 0,
) -> Recording:
    t, u = rising_sine(swing_V, f_Hz, periods, rate_Hz)
    period = round(rate_Hz / f_Hz)
    x = stage.measure(u, rate_Hz, seed, period if abs(period * f_Hz / rate_Hz - 1) < 1e-9 else 0)
    return record(t, u, x, slice(settle * period, None), f"sine {swing_V:g} V {f_Hz:g} Hz")


def record(t: Array, u: Array, x: Array | None, scored: slice = slice(None), source: str = "made") -> Recording:
    return Recording(t, {"x": AxisRecord(u, x)}, scored, source)


@dataclass(frozen=True)
class Grid:
    levels: tuple[float, ...] = (0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0)
    f_Hz: tuple[float, ...] = (1.0, 2.0, 5.0, 10.0, 20.0)
    rate_Hz: float = 5000.0
    periods: int = 5
    settle: int = 0
    stage: BenchStage = field(default_factory=BenchStage)

    def records(self) -> list[Recording]:
        return [
            sine_record(self.stage, a, f, self.periods, self.rate_Hz, self.settle, seed=round(1000 * a + f))
            for a in self.levels
            for f in self.f_Hz
        ]
