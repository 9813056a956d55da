"""Converter and amplifier: bit weights, dead time, current limit, lag, rails and leak, in volts."""

from __future__ import annotations

from math import exp
from typing import TYPE_CHECKING

import numpy as np

from .parts import Lag, Part, Samples

if TYPE_CHECKING:
    from .bench import Bench


class Converter(Part):
    """A segmented converter: unit elements for the upper bits and an R-2R ladder for the lower ones.

    The size of the elements drifts over the die, which bows the curve, and scatters; the ladder's bits have errors of
    their own, which repeat in each segment.

    ``largest_LSB`` is the largest departure from the line between the end codes, in steps; below 0 the bow hangs.
    Kester 2005, The Data Conversion Handbook, chapter 3.
    """

    station = "converter"
    segment_bits = 4

    def __init__(self, largest_LSB: float, bits: int, output_V: tuple[float, float], rng: np.random.Generator) -> None:
        self.low_V, self.step_V = output_V[0], (output_V[1] - output_V[0]) / 2**bits
        lower = bits - self.segment_bits
        units = np.linspace(1, -1, 2**self.segment_bits - 1) + 0.15 * rng.standard_normal(2**self.segment_bits - 1)
        per_segment = np.concatenate([[0.0], np.cumsum(units)])
        ladder = 0.4 * rng.standard_normal(lower) * 0.5 ** np.arange(lower)[::-1]
        codes = np.arange(2**bits)
        error = per_segment[codes >> lower] + ((codes[:, None] >> np.arange(lower)) & 1) @ ladder
        error -= error[0] + (error[-1] - error[0]) * codes / codes[-1]
        self.error_V = error * (largest_LSB / np.abs(error).max()) * self.step_V

    def run(self, x: Samples) -> Samples:
        code = np.rint((x - self.low_V) / self.step_V).astype(int)
        return x + self.error_V[np.clip(code, 0, len(self.error_V) - 1)]


class DeadTime:
    """Seconds between the converter and the amplifier, added to those of the stage."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds

    def attach(self, bench: Bench) -> None:
        bench.dead_time_s += self.seconds


class Amplifier(Part):
    """Follows with a small lag, and with no more current than it has: dv/dt = clip((u - v)/tau, -rate, rate)."""

    station = "amplifier"

    def __init__(self, tau_s: float, dt_s: float, level_V: float, most_V_per_s: float = np.inf) -> None:
        self.follower, self.most_V_per_s = Lag("amplifier", tau_s, dt_s, level_V), most_V_per_s

    def run(self, x: Samples) -> Samples:
        if np.isinf(self.most_V_per_s):
            return self.follower.run(x)
        share = 1 - exp(-self.follower.dt_s / self.follower.tau_s)
        most = self.most_V_per_s * self.follower.dt_s
        v, out = self.follower.last_out, []
        for u in (0.5 * (x + np.concatenate([[self.follower.last_in], x[:-1]]))).tolist():
            step = (u - v) * share
            v += most if step > most else -most if step < -most else step
            out.append(v)
        self.follower.last_in, self.follower.last_out = float(x[-1]), v
        return np.array(out)

    def pause(self, level: float, seconds: float) -> float:
        return self.follower.pause(level, seconds)


class CurrentLimit:
    """The amplifier that is there gets less current."""

    def __init__(self, most_V_per_s: float) -> None:
        self.most_V_per_s = most_V_per_s

    def attach(self, bench: Bench) -> None:
        bench.amplifier.most_V_per_s = self.most_V_per_s


class Rails(Part):
    """Supply rails: the voltage bends over within a narrow knee and stays there."""

    station = "amplifier"

    def __init__(self, low_V: float, high_V: float, knee_V: float) -> None:
        self.low_V, self.high_V, self.knee_V = low_V, high_V, knee_V

    def run(self, x: Samples) -> Samples:
        under = self.high_V - self.knee_V * np.logaddexp(0.0, (self.high_V - x) / self.knee_V)
        return self.low_V + self.knee_V * np.logaddexp(0.0, (under - self.low_V) / self.knee_V)


class Leak(Part):
    """A charge drive whose charge runs off towards 0 V: what has leaked follows the voltage with 1/rate."""

    station = "amplifier"

    def __init__(self, rate_per_s: float, dt_s: float, level_V: float) -> None:
        self.gone = Lag("amplifier", 1 / rate_per_s, dt_s)
        self.gone.last_in = level_V

    def run(self, x: Samples) -> Samples:
        return x - self.gone.run(x)

    def pause(self, level: float, seconds: float) -> float:
        return level - self.gone.pause(level, seconds)
