"""Hidden between the recorded voltage and the voltage at the material."""

from __future__ import annotations

from itertools import pairwise
from math import tanh

import numpy as np
from numpy.typing import NDArray

from .linear import Shift, lag
from .stage import Effect

Samples = NDArray[np.float64]


class Delay(Effect):
    """Dead time on top of the base's, by a line of past samples on the fine grid (the catalogue interpolates rows)."""

    name, unit, typical = "delay", "s", 2e-4
    family = "a line of past samples on a grid eight times finer"

    def prepare(self) -> None:
        self.line = Shift(self.value, self.stage.fine_s)

    def electrical(self, v: Samples) -> Samples:
        return self.line.step(v)


class AmplifierLowpass(Effect):
    """Output resistance into the actuator's capacitance, behind a second and twelve times faster pole of the output
    stage (the catalogue has one pole)."""

    name, unit, typical = "amplifier_lowpass", "s", 1.6e-4
    family = "two real poles, one twelve times faster"

    def prepare(self) -> None:
        self.poles = [lag(tau, self.stage.fine_s) for tau in (self.value * 11 / 12, self.value / 12)]

    def electrical(self, v: Samples) -> Samples:
        for pole in self.poles:
            v = pole.step(v)
        return v


class SlewLimit(Effect):
    """A limited current that is reached softly: dv = S tanh((u - v)/S) from step to step of the fine grid follows
    exactly what is slow (the catalogue clips differences between rows). The size is the span over the rate."""

    name, unit, typical = "slew_limit", "s", 0.01
    family = "a loop whose rate saturates like a hyperbolic tangent"

    def prepare(self) -> None:
        self.v = 0.0

    def electrical(self, v: Samples) -> Samples:
        most = self.stage.span_V / self.value * self.stage.fine_s
        now, out = self.v, []
        for target in v.tolist():
            now += most * tanh((target - now) / most)
            out.append(now)
        self.v = now
        return np.array(out)


class Saturation(Effect):
    """Rails with a soft knee of 0.3 % of the span (the catalogue clips)."""

    name, unit, typical = "saturation", "of voltage range", 0.05
    family = "softplus rails at both ends"

    def electrical(self, v: Samples) -> Samples:
        span = self.stage.span_V
        knee, low, high = 0.003 * span, self.value * span, (1 - self.value) * span
        v = low + knee * np.logaddexp(0, (v - low) / knee)
        return high - knee * np.logaddexp(0, (high - v) / knee)


class ChargeLeakage(Effect):
    """Leakage whose conductance grows with the voltage (Poole-Frenkel), integrated over stretches of 10 ms (the
    catalogue has a linear high-pass)."""

    name, unit, typical = "charge_leakage", "1/s", 0.01
    family = "leakage with a conductance that grows by 30 % towards the full voltage"

    def prepare(self) -> None:
        self.lost, self.last = 0.0, 0.0

    def converter(self, u: Samples) -> Samples:
        each = max(1, round(0.01 * self.stage.rate_Hz))
        edges = np.append(np.arange(0, len(u), each), len(u))
        marks = [self.lost]
        for a, b in pairwise(edges.tolist()):
            self._leak(float(u[a:b].mean()), (b - a) / self.stage.rate_Hz)
            marks.append(self.lost)
        self.last = float(u[-1])
        return u - np.interp(np.arange(1, len(u) + 1), edges, marks)

    def _leak(self, u: float, seconds: float) -> None:
        across = u - self.lost
        rate = self.value * (1 + 0.3 * abs(across) / self.stage.span_V)
        self.lost = u - across * float(np.exp(-rate * seconds))

    def rest(self, seconds: float) -> None:
        self._leak(self.last, seconds)


class DacNonlinearity(Effect):
    """Integral nonlinearity of a 12-bit converter: a gradient of the resistor string and, smaller, mismatched binary
    weights with their jumps (the catalogue has a bow, an S and waves)."""

    name, unit, typical = "dac_nonlinearity", "LSB", 2.0
    family = "resistor gradient and mismatched binary weights of a 12-bit converter"

    def prepare(self) -> None:
        bits = self.stage.bits
        codes = np.arange(2**bits)
        share = codes / codes[-1]
        bow = 4 * share * (1 - share) * (1 + 0.4 * (share - 0.5))
        weights = self.rng.normal(size=bits) * np.sqrt(2.0 ** np.arange(bits))
        carries = ((codes[:, None] >> np.arange(bits)) & 1) @ weights
        carries = carries - np.interp(share, [0, 1], [carries[0], carries[-1]])
        self.error_LSB = self.value * (bow + 0.25 * carries / np.abs(carries).max())

    def converter(self, u: Samples) -> Samples:
        lsb = self.stage.lsb_V
        zero = len(self.error_LSB) // 2
        at = np.clip(np.round(u / lsb).astype(int) + zero, 0, len(self.error_LSB) - 1)
        return u + lsb * (self.error_LSB[at] - self.error_LSB[zero])


EFFECTS = (Delay, AmplifierLowpass, SlewLimit, Saturation, ChargeLeakage, DacNonlinearity)
