"""``square:10um@5Hz``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phaselead.waveforms.edges import stairs
from phaselead.waveforms.waveform import Periodic, Shares


@dataclass(frozen=True, eq=False)
class Square(Periodic):
    """Up for half a period, down for the other, with edges of a twentieth of the period."""

    kind = "square"
    jumps = True
    written = (("square:10um@5Hz", "up for half a period, down for the other; edges take a twentieth of it"),)
    order = 5

    def shape(self, turns: Shares) -> Shares:
        return stairs(turns, np.array([1.0, 0.0]))
