"""What a part of a stage is, and the linear ones: lags and modes, exact for straight lines between points.

A part takes and gives volts or micrometres on a fine grid of time, and carries its history from call to call.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

Samples = NDArray[np.float64]
Mode = tuple[float, float, float]
"""Share of the static motion, undamped natural frequency in Hz, damping ratio."""


class Part:
    """Base of all parts; one that knows no time needs ``run`` only."""

    def run(self, x: Samples) -> Samples:
        """(n,) what comes out while ``x`` (n,) goes in."""
        raise NotImplementedError

    def rest(self, seconds: float, x: float) -> float:
        """What comes out after a stand-still, during which what goes in went slowly on to ``x``."""
        return float(self.run(np.array([x]))[-1])


class Lag(Part):
    """1 / (1 + s tau), standing at ``start``."""

    def __init__(self, tau_s: float, dt_s: float, start: float) -> None:
        self.tau_s, self.dt_s = tau_s, dt_s
        self.x = self.y = start

    def _weights(self, seconds: float) -> tuple[float, float, float]:
        """Of the last output, the last input and the new one, where the input goes straight."""
        pole = math.exp(-seconds / self.tau_s)
        straight = (1 - pole) * self.tau_s / seconds
        return pole, straight - pole, 1 - straight

    def run(self, x: Samples) -> Samples:
        pole, before, now = self._weights(self.dt_s)
        y, _ = lfilter([now, before], [1, -pole], x, zi=[before * self.x + pole * self.y])
        self.x, self.y = float(x[-1]), float(y[-1])
        return np.asarray(y, float)

    def rest(self, seconds: float, x: float) -> float:
        pole, before, now = self._weights(seconds)
        self.x, self.y = x, pole * self.y + before * self.x + now * x
        return self.y


class Oscillator(Part):
    """w^2 / (s^2 + 2 zeta w s + w^2), standing at ``start``."""

    def __init__(self, f_Hz: float, zeta: float, dt_s: float, start: float) -> None:
        w = 2 * math.pi * f_Hz
        numerator, denominator, _ = cont2discrete(([w * w], [1, 2 * zeta * w, w * w]), dt_s, method="foh")
        self.b, self.a = np.ravel(numerator), np.ravel(denominator)
        self.b *= self.a.sum() / self.b.sum()
        self.stand(start)

    def stand(self, x: float) -> None:
        """Without motion at ``x``."""
        last = (self.b[2] - self.a[2]) * x
        self.state = np.array([(self.b[1] - self.a[1]) * x + last, last])

    def run(self, x: Samples) -> Samples:
        y, self.state = lfilter(self.b, self.a, x, zi=self.state)
        return np.asarray(y, float)

    def rest(self, seconds: float, x: float) -> float:
        self.stand(x)
        return x


class Modes(Part):
    """Modes side by side; what they do not carry of the static motion is stiff."""

    def __init__(self, modes: Sequence[Mode], dt_s: float, start: float) -> None:
        self.modes = [(share, Oscillator(f_Hz, zeta, dt_s, start)) for share, f_Hz, zeta in modes]
        self.stiff = 1 - sum(share for share, _ in self.modes)

    def run(self, x: Samples) -> Samples:
        y = self.stiff * x
        for share, mode in self.modes:
            y = y + share * mode.run(x)
        return y

    def rest(self, seconds: float, x: float) -> float:
        for _, mode in self.modes:
            mode.stand(x)
        return x
