"""``chirp:5um@1..50Hz``: a sine whose frequency rises."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from phaselead.waveforms.curve import Curve
from phaselead.waveforms.waveform import POINTS, Shares
from phaselead.waveforms.written import Written

POINTS_A_CYCLE = 20
"""Of the fastest cycle: straight lines between them leave the sine by at most 0.6 % of its swing."""


@dataclass(frozen=True, eq=False)
class Chirp(Curve):
    """A whole number of cycles, the first at ``low_Hz``, the last at ``high_Hz``; as long as 1024 points allow."""

    low_Hz: float
    high_Hz: float

    kind = "chirp"
    written = (("chirp:5um@1..50Hz", "a sine from 1 to 50 Hz, 1 s long"),)
    order = 7

    @classmethod
    def parse(cls, written: Written) -> Self:
        head, dots, last = written.rest.rpartition("..")
        if not dots:
            raise written.refusal("has no range of frequencies")
        body, at, first = head.rpartition("@")
        unit_of = "" if first[-1:].isalpha() else last.strip().lstrip("0123456789.eE+-")
        _, low_Hz = Written(written.text, f"1um@{first}{unit_of}", written.example).at_frequency()
        _, high_Hz = Written(written.text, f"1um@{last}", written.example).at_frequency()
        if not at or low_Hz >= high_Hz:
            raise written.refusal("its frequencies must rise")
        swing, offset, unit = written.levels(body)
        if swing <= 0:
            raise written.refusal(f"its swing {swing:g} {unit} must be above 0 (peak-to-peak)")
        cycles = int((low_Hz + high_Hz) / 2 * POINTS / POINTS_A_CYCLE / high_Hz)
        return cls(swing, offset, unit, (low_Hz + high_Hz) / (2 * cycles), low_Hz, high_Hz)

    def scaled(self, *, swing: float = 1.0, time: float = 1.0) -> Self:
        found = super().scaled(swing=swing, time=time)
        return replace(found, low_Hz=self.low_Hz / time, high_Hz=self.high_Hz / time)

    def shape(self, turns: Shares) -> Shares:
        cycles = turns * (self.low_Hz + (self.high_Hz - self.low_Hz) / 2 * turns) / self.f_Hz
        return np.asarray((1 - np.cos(2 * np.pi * cycles)) / 2)
