"""A path that repeats and is sent while it is played, in place of the one that was asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from phaselead.waveforms.path import TICK_HZ, Repeated
from phaselead.waveforms.replaced import as_shown, levels
from phaselead.waveforms.waveform import Shares, Waveform

A_TICK = 4
"""Rows of a tick in which a lag is worked out, at least: lines between them leave a sine of 500 Hz by 0.3 %."""


@dataclass(frozen=True, eq=False)
class RepeatedAsSensed(Repeated):
    """What ``Replaced`` is for a path of 1024 points: ``times_s`` and ``values`` are played, ``wanted`` was asked for,
    and judged is the measured position against ``value``."""

    wanted: Repeated
    late: Shares = field(repr=False)
    """What the lag adds to the values, shape of ``times_s``."""
    lag_s: float = 0.0
    rounding_s: float = 0.0

    @classmethod
    def of(cls, wanted: Repeated, lag_s: float, rounding_s: float = 0.0) -> Self:
        """What a sensor late by ``lag_s`` shows of a stage that is where it was asked to be, but for corners."""
        asked = _asked(wanted)
        averaged_s = 1 / TICK_HZ if wanted.is_finer_than(1 / TICK_HZ) else 0.0
        at_once, later = (as_shown(asked, wanted.f_Hz, s, (averaged_s, rounding_s)) for s in (0.0, lag_s))
        lowest, swing = levels(later)
        times_s = np.linspace(0, wanted.duration_s, len(asked) + 1)
        late, values = (np.append(one, one[0]) for one in (later - at_once, later))
        return cls(swing, lowest, wanted.unit, wanted.f_Hz, times_s, values, wanted, late, lag_s, rounding_s)

    def share(self, turns: Shares) -> Shares:
        t_s = np.asarray(turns) / self.f_Hz
        asked = self.wanted.value(t_s) + np.interp(t_s % self.duration_s, self.times_s, self.late)
        return np.asarray((asked - self.offset) / self.swing)

    @property
    def as_asked(self) -> Waveform:
        return self.wanted

    @property
    def unplayed(self) -> float:
        if self.rounding_s == 0:
            return self.wanted.unplayed
        asked = _asked(self.wanted)
        rounded = as_shown(asked, self.f_Hz, 0.0, (self.rounding_s,))
        return max(self.wanted.unplayed, float(np.abs(rounded - asked).max()))

    def is_finer_than(self, point_s: float) -> bool:
        """What points cannot play is out of it already."""
        return False


def _asked(wanted: Repeated) -> Shares:
    """One period at equal distances, (n,), no further apart than half of its rows and a quarter of a tick."""
    count = max(A_TICK * math.ceil(wanted.duration_s * TICK_HZ), 2 * len(wanted.values))
    return wanted.value(np.arange(count) / count * wanted.duration_s)
