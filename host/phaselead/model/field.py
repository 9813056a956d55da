"""The field that the material answers to, for a voltage: it need not rise evenly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from phaselead.record import Samples

V = TypeVar("V", float, Samples)


@dataclass(frozen=True)
class Field:
    """The field over a span of voltages, in volts of the field of an even one: v + bend (v^2 - 2 v_mid v) / (U/2).

    It is 0 at 0 V. From one end of the span to the other its slope changes from 1 - 2 bend to 1 + 2 bend.
    """

    bend: float = 0.0
    span_V: tuple[float, float] = (-1.0, 1.0)

    def at(self, v: V) -> V:
        """At voltages in V, of the same shape."""
        if not self.bend:
            return v
        low, high = self.span_V
        return v + self.bend * (v * v - (low + high) * v) * (2 / (high - low))


EVEN = Field()
"""That of a model that says nothing of it."""
