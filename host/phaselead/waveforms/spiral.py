"""``spiral:60um/10@5Hz``: from the centre out and back, at one angular speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from phaselead.waveforms.curve import Curve
from phaselead.waveforms.scan import Scan, counted
from phaselead.waveforms.waveform import Shares, Waveform
from phaselead.waveforms.written import Written

MOST_TURNS = 25
"""Out, and as many in: 20 points a turn."""


@dataclass(frozen=True, eq=False)
class SpiralAxis(Curve):
    """What one axis does of it: ``angles`` in whole turns, out and in, ``ahead`` of the cosine by a share of one."""

    angles: int
    ahead: float

    def shape(self, turns: Shares) -> Shares:
        radius = (1 - np.cos(2 * np.pi * turns)) / 2
        return np.asarray((1 + radius * np.cos(2 * np.pi * (self.angles * turns + self.ahead))) / 2)


class Spiral(Scan):
    """Its radius rises and falls as a sine does, once a period; it begins and ends in the middle, without a corner."""

    kind = "spiral"
    written = (("spiral:60um/10@5Hz", "60 um across in x and y: 10 turns out from the middle and 10 in, 5 a second"),)
    order = 10

    @classmethod
    def parse(cls, written: Written) -> Mapping[str, Waveform]:
        body, turns, f_Hz = counted(written, "turns", MOST_TURNS)
        across, lowest, unit = written.levels(body)
        if across <= 0:
            raise written.refusal("it must be above 0 across")
        return {
            axis: SpiralAxis(across, lowest, unit, f_Hz / (2 * turns), 2 * turns, ahead)
            for axis, ahead in (("x", 0.0), ("y", -0.25))
        }
