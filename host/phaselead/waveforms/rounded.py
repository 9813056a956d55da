"""A path that is sent once, with its corners rounded, in place of the one that was asked for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from phaselead.waveforms.path import AVERAGED, TICK_HZ, Streamed
from phaselead.waveforms.waveform import Shares, Waveform

FINE_HZ = AVERAGED * TICK_HZ
"""Of the values that means are worked out on."""
AT_ONCE = 1 << 18
"""Values that are worked out together: a path may take hours."""


@dataclass(frozen=True, eq=False)
class Rounded(Streamed):
    """``wanted`` is what a run is judged by; played is that behind two means over ``rounding_s``, one after the other,
    a point a tick."""

    wanted: Streamed
    rounding_s: float

    @classmethod
    def of(cls, wanted: Streamed, rounding_s: float) -> Self:
        own = wanted.swing, wanted.offset, wanted.unit, wanted.f_Hz, wanted.times_s, wanted.values
        return cls(*own, wanted, rounding_s)

    @property
    def as_asked(self) -> Waveform:
        return self.wanted

    def scaled(self, *, swing: float = 1.0, time: float = 1.0) -> Self:
        return replace(super().scaled(swing=swing, time=time), wanted=self.wanted.scaled(swing=swing, time=time))

    def part(self, begin_s: float, seconds: float) -> Streamed:
        return self.of(self.wanted.part(begin_s, seconds), self.rounding_s)

    @property
    def log2(self) -> int:
        return 0

    def points_of(self, first: int, count: int, log2: int) -> Shares:
        each = AVERAGED << log2
        return self._played(first * each, (count - 1) * each + 1)[::each]

    @cached_property
    def unplayed(self) -> float:
        left = 0.0
        for first, count in parts(0, int(self.duration_s * FINE_HZ) + 1):
            asked = self._shares((first + np.arange(count)) / FINE_HZ)
            left = max(left, float(np.abs(self._played(first, count) - asked).max()))
        return max(left * self.swing, self.wanted.unplayed)

    def _played(self, first: int, count: int) -> Shares:
        """Shares of the swing from the fine one of this number on, (count,)."""
        over_tick = 1 / TICK_HZ if self.is_finer_than(1 / TICK_HZ) else 0.0
        mean = np.convolve(mean_weights(over_tick), mean_weights(self.rounding_s))
        half = len(mean) // 2
        shares = self._shares((first + np.arange(-half, count + half)) / FINE_HZ)
        return np.convolve(shares, mean, "valid")


def mean_weights(over_s: float) -> Shares:
    """Of two means over so long, one after the other, at the fine rate."""
    half = int(over_s * FINE_HZ)
    weights = np.maximum(1 - np.abs(np.arange(-half, half + 1)) / max(over_s * FINE_HZ, 1.0), 0.0)
    return np.asarray(weights / weights.sum())


def parts(begin: int, end: int) -> Iterator[tuple[int, int]]:
    """First and count of each part."""
    for first in range(begin, end, AT_ONCE):
        yield first, min(AT_ONCE, end - first)
