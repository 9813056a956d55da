"""From the converter's codes to the volts at the ceramic."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from .parts import Lag, Part, Samples
from .sliders import Sliders


class Converter:
    """A string of resistors that bows, and weights of the first bits that are off (Kester 2005, section 6.1).

    ``inl_LSB`` is the largest departure from the line between the end codes, with its sign. Less its error at
    ``rest_V``, where the lab calls the output zero.
    """

    def __init__(
        self,
        bits: int,
        low_V: float,
        high_V: float,
        inl_LSB: float,
        bow: float,
        skew: float,
        weights: tuple[float, ...],
    ) -> None:
        codes = np.arange(2**bits)
        s = codes / codes[-1]
        error = 4 * bow * s * (1 - s) * (1 + skew * (2 * s - 1))
        for i, weight in enumerate(weights):
            error += weight * ((codes >> (bits - 1 - i) & 1) - s)
        self.low_V, self.lsb_V = low_V, (high_V - low_V) / 2**bits
        self.error_V = self.lsb_V * inl_LSB * error / error[np.argmax(np.abs(error))]

    def volts(self, u: Samples) -> Samples:
        """What it gives where u, on its grid, is asked for."""
        codes = np.round((u - self.low_V) / self.lsb_V).astype(int)
        return np.asarray(u + self.error_V[codes])


class Rails(Part):
    """Rails with soft knees: a transistor near its rail gives way exponentially. None is no rail."""

    def __init__(self, low_V: float | None, high_V: float | None, knee_V: float) -> None:
        self.low_V, self.high_V, self.knee_V = low_V, high_V, knee_V

    def run(self, u: Samples) -> Samples:
        if self.high_V is not None:
            u = u - self.knee_V * np.logaddexp(0, (u - self.high_V) / self.knee_V)
        if self.low_V is not None:
            u = u + self.knee_V * np.logaddexp(0, (self.low_V - u) / self.knee_V)
        return u


class Loop(Part):
    """The amplifier's loop of one pole at 1 / tau.

    Its current may have a limit, ``up_V_per_s`` and ``down_V_per_s`` at the load, and its output stage a dead zone of
    ``zone_V`` that its drive must cross, bridged by the share ``leak`` of a quiescent current (class AB).
    """

    def __init__(
        self,
        tau_s: float,
        dt_s: float,
        start: float,
        up_V_per_s: float = math.inf,
        down_V_per_s: float = math.inf,
        zone_V: float = 0.0,
        leak: float = 0.0,
    ) -> None:
        self.path, self.gain = dt_s / tau_s, 1 - math.exp(-dt_s / tau_s)
        self.up_V, self.down_V = up_V_per_s * dt_s, down_V_per_s * dt_s
        self.half_V, self.leak = zone_V / 2, leak
        self.drive = self.out = start

    def run(self, u: Samples) -> Samples:
        if self.half_V == 0 and math.isinf(self.up_V):
            v, _ = lfilter([self.gain], [1, self.gain - 1], u, zi=[(1 - self.gain) * self.out])
            self.drive = self.out = float(v[-1])
            return np.asarray(v, float)
        path, up, down, half, leak, exp = self.path, self.up_V, self.down_V, self.half_V, self.leak, math.exp
        drive, out, found = self.drive, self.out, []
        for x in u.tolist():
            step = path * (x - (1 - leak) * out - leak * drive)
            step = up if step > up else -down if step < -down else step
            if step == 0 or (drive + step - out) * (1 if step > 0 else -1) <= half:  # inside the zone it integrates
                drive += step
            else:  # up to its edge, and on with the load
                room = (half if step > 0 else -half) - (drive - out)
                left = min(1 - room / step, 1.0)  # rounding may have put it past the edge
                drive += room
                move = (1 - exp(-path * left)) * (x - (1 - leak) * out - leak * drive)
                move = min(max(move, -down * left), up * left)
                drive += move
                out += move
            found.append((1 - leak) * out + leak * drive)
        self.drive, self.out = drive, out
        return np.array(found)

    def rest(self, seconds: float, x: float) -> float:
        further = x - (1 - self.leak) * self.out - self.leak * self.drive
        self.drive, self.out = self.drive + further, self.out + further
        return x


class GrowingLoad(Part):
    """A resistor into the capacitance of the ceramic, which grows with the voltage: tau is that at mid-range.

    The capacitance at either end differs by ``growth`` of it. Exact for straight lines between points.
    """

    def __init__(self, tau_s: float, growth: float, mid_V: float, half_V: float, dt_s: float, start: float) -> None:
        self.tau_s, self.dt_s, self.mid_V, self.slope = tau_s, dt_s, mid_V, growth / half_V
        self.u = self.v = start

    def run(self, u: Samples) -> Samples:
        path, mid, slope, exp = self.dt_s / self.tau_s, self.mid_V, self.slope, math.exp
        last, v, found = self.u, self.v, []
        for x in u.tolist():
            h = path / (1 + slope * (v - mid))
            pole = exp(-h)
            straight = (1 - pole) / h
            v = (1 - straight) * x + (straight - pole) * last + pole * v
            last = x
            found.append(v)
        self.u, self.v = last, v
        return np.array(found)

    def rest(self, seconds: float, x: float) -> float:
        self.u = self.v = x
        return x


class Leak(Part):
    """A charge drive loses its low frequencies (Fleming and Moheimani 2005): u less its lag, towards ``rest_V``."""

    def __init__(self, rate_per_s: float, rest_V: float, dt_s: float) -> None:
        self.lag, self.rest_V = Lag(1 / rate_per_s, dt_s, rest_V), rest_V

    def run(self, u: Samples) -> Samples:
        return u - (self.lag.run(u) - self.rest_V)

    def rest(self, seconds: float, x: float) -> float:
        return x - (self.lag.rest(seconds, x) - self.rest_V)


class Slack(Part):
    """Play between worn flanks, which meet over a fifth of the gap: ``width`` from one flank to the other."""

    def __init__(self, width: float, start: float) -> None:
        self.sliders = Sliders(width / 2 * np.array([0.9, 0.95, 1.0, 1.05, 1.1]), np.full(5, 0.2), start)

    def run(self, x: Samples) -> Samples:
        return self.sliders.held(x)
