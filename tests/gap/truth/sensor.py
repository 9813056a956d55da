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
    """Each sample taken a little early or late, on the parabola through the last three points of the fine grid (the
    catalogue has a variance in proportion to the squared rate)."""

    name, unit, typical = "sampling_jitter", "s", 2e-6
    family = "samples at random times on a parabola through three fine points"

    def prepare(self) -> None:
        self.before: Samples = np.zeros(0)

    def sampled(self, y: Samples) -> Samples:
        line = np.concatenate([self.before if len(self.before) else np.full(2, y[0]), y])
        self.before = y[-2:]
        rows = np.arange(OVERSAMPLING + 1, len(line), OVERSAMPLING)
        now, last, first = (line[rows - k] for k in (0, 1, 2))
        early = self.value * self.rng.standard_normal(len(rows)) / self.stage.fine_s
        return now + early * (1.5 * now - 2 * last + 0.5 * first) + early**2 * (0.5 * now - last + 0.5 * first)


EFFECTS = (SensorLowpass, SensorNonlinearity, GainChange, Offset, Quantisation, SamplingJitter)
