"""The field that the hysteresis answers to, for a voltage: it need not rise evenly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from phaselead.record import Samples


@dataclass(frozen=True)
class EffectiveField:
    """The field over a span of voltages, in volts of an even one: v + bend (U/2) s^2 less its value at 0 V, where s is
    -1 to 1 over the span; beyond the span it goes straight on.

    From one end of the span to the other its slope changes from 1 - 2 bend to 1 + 2 bend. Plays of such an envelope
    function of the voltage are those of Al Janaideh, Rakheja and Su 2009; here it is a parabola.
    """

    bend: float = 0.0
    span_V: tuple[float, float] = (-1.0, 1.0)

    def of(self, u_V: ArrayLike) -> Samples:
        """At voltages in V, of the same shape."""
        v = np.asarray(u_V, dtype=np.float64)
        return v + self._bent_V(v) - self._bent_V(np.zeros(())) if self.bend else v

    def at(self, u_V: float) -> float:
        """At one voltage in V."""
        return float(self.of(u_V))

    def _bent_V(self, v: Samples) -> Samples:
        low, high = self.span_V
        half = (high - low) / 2
        s = (v - (low + high) / 2) / half
        inside = np.clip(s, -1.0, 1.0)
        return np.asarray(self.bend * half * inside * (2 * s - inside))


EVEN = EffectiveField()
"""The voltage itself."""
LARGEST_BEND = 0.2
"""The slope of the field changes from 0.6 to 1.4 over the span then, or back."""
