"""``sine:60um@5Hz``: computed by the device, not played from points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phaselead.waveforms.waveform import Periodic, Shares


@dataclass(frozen=True, eq=False)
class Sine(Periodic):
    """From the offset up by the swing and back."""

    kind = "sine"
    written = (
        ("sine:60um@5Hz", "sine between 0 and 60 um"),
        ("sine:60um+20um@5Hz", "the same between 20 and 80 um"),
    )
    order = 1
    played_as = "sine"
    points = None

    def shape(self, turns: Shares) -> Shares:
        return np.asarray((1 - np.cos(2 * np.pi * turns)) / 2)

    def share(self, turns: Shares) -> Shares:
        return self.shape(turns)

    @property
    def steepest_share(self) -> float:
        return math.pi
