"""How the weight of a play depends on the level at which it stands: a Preisach density over thresholds and levels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from phaselead.record import Samples

MOST_UNEVEN = 0.8
"""Of the weight in the middle: how far tilt and taper together may take it off, at either end, or add to it."""


@dataclass(frozen=True)
class PlayDensity:
    """A play that stands at p volts moves as much as its weight times 1 + tilt s - taper s^2, where s is -1 to 1 over
    the span of the field; beyond that it goes on as at the end.

    A Preisach density that is a product, of one over the thresholds (the weights) and one over the levels (Brokate and
    Sprekels 1996, 2.4; Mayergoyz 2003); plays of one weight at all levels are an even one.
    """

    tilt: float = 0.0
    taper: float = 0.0
    span_V: tuple[float, float] = (-1.0, 1.0)

    @property
    def is_even(self) -> bool:
        """Whether plays weigh the same at all levels."""
        return not (self.tilt or self.taper)

    @property
    def mean(self) -> float:
        """Weight over the span, on the average."""
        return 1 - self.taper / 3

    def at(self, p_V: ArrayLike) -> Samples:
        """Weights at levels in V, of the same shape."""
        s = np.clip(self._share(p_V), -1.0, 1.0)
        return np.asarray(1 + s * (self.tilt - s * self.taper))

    def read(self, p_V: ArrayLike) -> Samples:
        """What plays add that stand at levels in V, of the same shape, a unit of weight each: in V, and 0 at 0 V."""
        p = np.asarray(p_V, dtype=np.float64)
        return p if self.is_even else self._passed_V(p) - self._passed_V(np.zeros(()))

    def _share(self, p_V: ArrayLike) -> Samples:
        low, high = self.span_V
        return np.asarray((2 * np.asarray(p_V, dtype=np.float64) - (low + high)) / (high - low))

    def _passed_V(self, p: Samples) -> Samples:
        """The weight over all levels from the middle of the span to p."""
        low, high = self.span_V
        s = self._share(p)
        inside = np.clip(s, -1.0, 1.0)
        passed = inside * (1 + inside * (self.tilt / 2 - inside * self.taper / 3))
        weight = 1 + inside * (self.tilt - inside * self.taper)
        return np.asarray((high - low) / 2 * (passed + weight * (s - inside)))


EVEN_DENSITY = PlayDensity()
"""Plays that weigh the same at all levels."""
