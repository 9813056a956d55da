"""``triangle:100um@20Hz``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phaselead.waveforms.waveform import Periodic, Shares


@dataclass(frozen=True, eq=False)
class Triangle(Periodic):
    """Up and down at one speed."""

    kind = "triangle"
    written = (("triangle:100um@20Hz", "triangle between 0 and 100 um"),)
    order = 2

    def shape(self, turns: Shares) -> Shares:
        return np.asarray(1 - np.abs(2 * turns - 1))
