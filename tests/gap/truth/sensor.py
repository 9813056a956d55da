"""Hidden in the sensor and its converter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .linear import lag
from .stage import OVERSAMPLING, Effect

Samples = NDArray[np.float64]


class SensorLowpass(Effect):
    """A demodulator's filter: one pole and a second, twelve times faster (the catalogue has one)."""

    name, unit, typical = "sensor_lowpass", "s", 8e-5
    family = "two real poles, one twelve times faster"

    def prepare(self) -> None:
        self.poles = [lag(tau, self.stage.fine_s) for tau in (self.value * 11 / 12, self.value / 12)]

    def sensed(self, y: Samples) -> Samples:
        for pole in self.poles:
            y = pole.step(y)
        return y


class SensorNonlinearity(Effect):
    """A bow that leans to the upper end, through a hyperbolic tangent (the catalogue has a polynomial); its peak is the
    size."""

    name, unit, typical = "sensor_nonlinearity", "of range", 0.002
    family = "(1 - s^2)(1 + tanh(2 s)/2), scaled to its peak"

    def prepare(self) -> None:
        s = np.linspace(-1, 1, 2001)
        self.scale = self.value * self.stage.range_um / np.abs(self._curve(s)).max()

    @staticmethod
    def _curve(s: Samples) -> Samples:
        return (1 - s**2) * (1 + 0.5 * np.tanh(2 * s))

    def measured(self, y: Samples, t: Samples) -> Samples:
        s = 2 * (y - self.stage.offset_um) / self.stage.range_um - 1
        return y + self.scale * self._curve(np.clip(s, -1.1, 1.1))


class GainChange(Effect):
    """Another scale of the sensor."""

    name, unit, typical = "gain_change", "1", 0.03
    family = "by definition"

    def measured(self, y: Samples, t: Samples) -> Samples:
        return y + self.value * (y - self.stage.offset_um)


class Offset(Effect):
    """Another zero of the sensor, the same in all records after the reference session."""

    name, unit, typical = "offset", "um", 1.0
    family = "by definition"

    def measured(self, y: Samples, t: Samples) -> Samples:
        return y + self.value


class Quantisation(Effect):
    """A converter with steps of 8 nm at size 1, rounding what the noise has already moved."""

    name, unit, typical = "quantisation", "um", 0.008
    family = "rounding"

    def digitised(self, y: Samples) -> Samples:
        return np.asarray(np.round(y / self.value) * self.value)


class SamplingJitter(Effect):
    """Each sample taken a little off, by interpolation on the fine grid at random times (the catalogue has a variance
    in proportion to the squared rate)."""

    name, unit, typical = "sampling_jitter", "s", 2e-6
    family = "interpolation at random times"

    def prepare(self) -> None:
        self.before: Samples = np.zeros(0)

    def sampled(self, y: Samples) -> Samples:
        n = len(y) // OVERSAMPLING
        rows = np.arange(1, n + 1) * OVERSAMPLING - 1.0
        # Never ahead of the last sample that is known.
        late = self.value * self.rng.standard_normal(n) / self.stage.fine_s - 0.5
        held = self.before if len(self.before) else np.full(OVERSAMPLING, y[0])
        line = np.concatenate([held, y])
        self.before = y[-OVERSAMPLING:]
        return np.interp(rows + np.clip(late, -OVERSAMPLING, 0) + len(held), np.arange(len(line)), line)


EFFECTS = (SensorLowpass, SensorNonlinearity, GainChange, Offset, Quantisation, SamplingJitter)
