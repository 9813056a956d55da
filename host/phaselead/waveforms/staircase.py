"""``staircase:60um/12@0.5Hz``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from phaselead.waveforms.edges import stairs
from phaselead.waveforms.scan import counted
from phaselead.waveforms.waveform import Periodic, Shares
from phaselead.waveforms.written import Written

MOST_STEPS = 32
"""Up, and as many down: 16 points a step, of which the edge takes one and a half."""


@dataclass(frozen=True, eq=False)
class Staircase(Periodic):
    """Up in equal steps and down again, each step a least-jerk edge and a rest."""

    steps: int

    kind = "staircase"
    written = (("staircase:60um/12@0.5Hz", "up by 60 um in 12 steps and down again, a rest on each"),)
    order = 6

    @classmethod
    def parse(cls, written: Written) -> Self:
        levels, steps, f_Hz = counted(written, "steps", MOST_STEPS)
        swing, lowest, unit = written.levels(levels)
        if swing <= 0:
            raise written.refusal(f"its swing {swing:g} {unit} must be above 0 (peak-to-peak)")
        return cls(swing, lowest, unit, f_Hz, steps)

    def shape(self, turns: Shares) -> Shares:
        up = np.arange(1, self.steps + 1) / self.steps
        return stairs(turns, np.concatenate([up, up[::-1][1:], [0.0]]))
