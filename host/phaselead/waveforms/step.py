"""``step:5um``: the reference jumps, for the answer of a loop to be seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from phaselead.waveforms.goto import Goto
from phaselead.waveforms.written import Written

JUMP_s = 0.0006
"""Three ticks: at once for a loop, whose bandwidth is some hundred hertz at most."""


@dataclass(frozen=True, eq=False)
class Step(Goto):
    """By ``swing`` from where the axis stands, at once."""

    kind = "step"
    written = (("step:5um", "the reference jumps by 5 um from where the axis stands (in mode open use goto)"),)
    order = 8

    @classmethod
    def parse(cls, written: Written) -> Self:
        way, unit = written.level(written.rest)
        if unit != "um":
            raise written.refusal("a step is in micrometres; for volts use goto:5V")
        return cls(way, 0.0, unit, 1 / JUMP_s)

    def from_start(self, start: float) -> Step:
        """The same step, from ``start``."""
        return replace(self, offset=start)
