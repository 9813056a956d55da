"""What a periodic path is that bends between the points that the device plays of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from phaselead.waveforms.waveform import POINTS, Periodic, Shares

EACH = 16
"""Places between two points at which curve and line are compared."""


@dataclass(frozen=True, eq=False)
class Curve(Periodic):
    """The device plays 1024 points of a period, joined by straight lines; a run is judged by the curve itself."""

    def share(self, turns: Shares) -> Shares:
        return self.shape(np.asarray(turns) % 1.0)

    def playable(self, t_s: ArrayLike) -> Shares:
        lines = super().share(np.asarray(t_s, np.float64) * self.f_Hz)
        return np.asarray(self.offset + self.swing * lines)

    @cached_property
    def unplayed(self) -> float:
        t_s = np.arange(POINTS * EACH) / (POINTS * EACH) / self.f_Hz
        return float(np.abs(self.value(t_s) - self.playable(t_s)).max())
