"""What every rival is made from: the sines of one identification, and the response that a tuning measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]
TICK_S = 2e-4


@dataclass(frozen=True)
class Sine:
    """One record from rest, open loop: applied voltage and measured position (n,), its swing and frequency; the rows
    from ``settled`` on are steady."""

    u_V: Samples
    x_um: Samples
    swing_V: float
    f_Hz: float
    settled: int

    @cached_property
    def response(self) -> tuple[float, float]:
        """Gain in um/V and lag in rad at its frequency, over its whole steady periods."""
        period = round(1 / (self.f_Hz * TICK_S))
        rows = slice(self.settled, self.settled + (len(self.u_V) - self.settled) // period * period)
        turn = np.exp(-2j * np.pi * self.f_Hz * TICK_S * np.arange(rows.start, rows.stop))
        ratio = (self.x_um[rows] @ turn) / (self.u_V[rows] @ turn)
        return float(np.abs(ratio)), float(-np.angle(ratio))


@dataclass(frozen=True)
class Evidence:
    """Records, the response (m,) in um/V of small motions, and the data sheet: limits, first mode, lag of the sensor.

    ``first_mode_Hz`` is the largest peak of the response above 30 Hz."""

    sines: Sequence[Sine]
    f_Hz: Samples
    gain: NDArray[np.complex128]
    u_limits_V: tuple[float, float]
    sensor_lag_s: float

    @cached_property
    def first_mode_Hz(self) -> float:
        return float(self.f_Hz[np.argmax(np.abs(self.gain) * (self.f_Hz > 30.0))])

    @cached_property
    def grid(self) -> tuple[Samples, Samples, Samples, Samples]:
        """Of every sine: swing in V, frequency in Hz, gain in um/V, lag in rad, each (k,)."""
        rows = [(one.swing_V, one.f_Hz, *one.response) for one in self.sines]
        swing, f_Hz, gain, lag = np.array(rows).T
        return swing, f_Hz, gain, lag

    def response_at(self, f_Hz: float | Samples) -> NDArray[np.complex128]:
        """Of small motions, between the lines by magnitude and phase."""
        size = np.interp(f_Hz, self.f_Hz, np.abs(self.gain))
        return np.asarray(size * np.exp(1j * np.interp(f_Hz, self.f_Hz, np.unwrap(np.angle(self.gain)))))

    def save(self, path: Path) -> None:
        """As one file of arrays."""
        heads = np.array([(one.swing_V, one.f_Hz, one.settled, len(one.u_V)) for one in self.sines])
        np.savez_compressed(
            path,
            heads=heads,
            u_V=np.concatenate([one.u_V for one in self.sines]),
            x_um=np.concatenate([one.x_um for one in self.sines]),
            f_Hz=self.f_Hz,
            gain=self.gain,
            sheet=np.array([*self.u_limits_V, self.sensor_lag_s]),
        )

    @classmethod
    def load(cls, path: Path) -> Evidence:
        with np.load(path) as kept:
            ends = np.cumsum(kept["heads"][:, 3].astype(int))[:-1]
            columns = (np.split(kept[name], ends) for name in ("u_V", "x_um"))
            sines = [
                Sine(u, x, float(swing), float(f), int(settled))
                for (swing, f, settled, _), u, x in zip(kept["heads"], *columns, strict=True)
            ]
            low, high, lag = map(float, kept["sheet"])
            return cls(sines, kept["f_Hz"], kept["gain"], (low, high), lag)
