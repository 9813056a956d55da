"""Hidden in the room."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from .linear import Filter, mode
from .stage import Effect

Samples = NDArray[np.float64]


class ThermalDrift(Effect):
    """Heat that diffuses into the frame: a square root of the time since the session began, and the room's slow swing
    (the catalogue has a ramp and an exponential). The size is the mean rate over two minutes."""

    name, unit, typical = "thermal_drift", "um/s", 0.002
    family = "square root of time, and a swing of twelve minutes"
    OVER_S = 120.0

    def prepare(self) -> None:
        self.began: float | None = None
        self.phase = self.rng.uniform(0, 2 * np.pi)
        self.sign = self.rng.choice([-1.0, 1.0])

    def measured(self, y: Samples, t: Samples) -> Samples:
        self.began = float(t[0]) if self.began is None else self.began
        since = t - self.began
        tau = 200.0
        way = np.sqrt(1 + since / tau) - 1
        way = way / (np.sqrt(1 + self.OVER_S / tau) - 1) * self.OVER_S
        turn = 2 * np.pi / 720
        swing = (np.sin(turn * since + self.phase) - np.sin(self.phase)) * 0.15 * self.OVER_S
        return y + self.sign * self.value * (way + swing)


class MainsHum(Effect):
    """The mains, a few hundredths of a hertz off, swelling slowly, with two harmonics. The size is the amplitude of the
    fundamental."""

    name, unit, typical = "mains_hum", "um", 0.01
    family = "three lines whose amplitude swells by a tenth"

    def prepare(self) -> None:
        self.f_Hz = 50 + self.rng.normal(0, 0.02)
        self.phases = self.rng.uniform(0, 2 * np.pi, 4)
        self.shares = np.array([1.0, 0.3, 0.3])

    def measured(self, y: Samples, t: Samples) -> Samples:
        swell = 1 + 0.1 * np.sin(2 * np.pi * t / 37 + self.phases[3])
        lines = sum(
            share * np.sin(2 * np.pi * h * self.f_Hz * t + phase)
            for h, share, phase in zip((1, 2, 3), self.shares, self.phases[:3], strict=True)
        )
        return y + self.value * swell * lines


class Vibration(Effect):
    """A machine on the floor: a mode of the building shaken by white force, integrated in time (the catalogue has the
    spectrum only)."""

    name, unit, typical = "vibration", "um", 0.01
    family = "a mode of the building driven by white noise, integrated in time"

    def prepare(self) -> None:
        f_Hz = float(np.exp(self.rng.uniform(np.log(14.0), np.log(130.0))))
        f_Hz = f_Hz + 7 if abs(f_Hz / 50 - round(f_Hz / 50)) < 0.06 else f_Hz
        self.f_Hz, self.zeta = f_Hz, float(np.exp(self.rng.uniform(np.log(0.01), np.log(0.15))))
        part = mode(self.f_Hz, self.zeta, 1 / self.stage.rate_Hz)
        calm = round(10 * self.stage.rate_Hz)
        kick = np.zeros(calm)
        kick[0] = 1.0
        self.scale = self.value / np.sqrt(np.sum(lfilter(part.b, part.a, kick) ** 2))
        self.part = Filter(part.b, part.a)
        self.part.step(self.rng.standard_normal(calm))

    def measured(self, y: Samples, t: Samples) -> Samples:
        return y + self.scale * self.part.step(self.rng.standard_normal(len(y)))


EFFECTS = (ThermalDrift, MainsHum, Vibration)
