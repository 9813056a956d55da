"""``spiral:60um/10@5Hz``: from the centre out and back, at one angular speed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from phaselead.waveforms.scan import Scan, counted
from phaselead.waveforms.waveform import POINTS, Sampled, Shares, Waveform
from phaselead.waveforms.written import Written

MOST_TURNS = 25
"""Out, and as many in: 20 points a turn."""


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
        once = np.arange(POINTS) / POINTS
        radius, angle = (1 - np.cos(2 * np.pi * once)) / 2, 2 * np.pi * 2 * turns * once

        def axis(wave: Shares) -> Sampled:
            return Sampled(across, lowest, unit, f_Hz / (2 * turns), (1 + radius * wave) / 2)

        return {"x": axis(np.cos(angle)), "y": axis(np.sin(angle))}
