"""A path that repeats and is sent while it is played, in place of the one that was asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from phaselead.waveforms.path import AVERAGED, TICK_HZ, Repeated
from phaselead.waveforms.rounded import FINE_HZ, mean_weights, parts
from phaselead.waveforms.waveform import Shares, Waveform

WARM_UP = 40
"""Time constants of the lag: what was before them is worth less than a part in 10^17."""


@dataclass(frozen=True, eq=False)
class RepeatedAsSensed(Repeated):
    """What ``Replaced`` is for a path of 1024 points: judged is the measured position against ``value``, what a sensor
    late by ``lag_s`` shows of a stage that is where it was asked to be. Played is that with its corners rounded."""

    wanted: Repeated
    lag_s: float = 0.0
    rounding_s: float = 0.0

    @classmethod
    def of(cls, wanted: Repeated, lag_s: float, rounding_s: float = 0.0) -> Self:
        # A lag and means neither leave the range of a path nor are steeper.
        own = wanted.swing, wanted.offset, wanted.unit, wanted.f_Hz, wanted.times_s, wanted.values
        return cls(*own, wanted, lag_s, rounding_s)

    def share(self, turns: Shares) -> Shares:
        t_s = np.asarray(turns, np.float64) / self.f_Hz
        return np.asarray((self.wanted.value(t_s) + self._late(t_s % self.duration_s) - self.offset) / self.swing)

    @property
    def as_asked(self) -> Waveform:
        return self.wanted

    def scaled(self, *, swing: float = 1.0, time: float = 1.0) -> Self:
        return replace(super().scaled(swing=swing, time=time), wanted=self.wanted.scaled(swing=swing, time=time))

    @property
    def log2(self) -> int:
        return 0 if self.rounding_s > 0 else self.wanted.log2  # a corner may lie between points that are far apart

    @cached_property
    def unplayed(self) -> float:
        left = self.wanted.unplayed
        if self.rounding_s > 0:
            for first, count in parts(0, math.ceil(self.duration_s * FINE_HZ)):
                asked = self._at((first + np.arange(count)) / FINE_HZ)
                left = max(left, float(np.abs(self._played(first, count, 0.0) - asked).max()))
        return left

    def points_of(self, first: int, count: int, log2: int) -> Shares:
        each = AVERAGED << log2
        values = self._played(first * each, (count - 1) * each + 1, self.lag_s)[::each]
        return np.clip((values - self.offset) / self.swing, 0.0, 1.0)

    def _played(self, first: int, count: int, lag_s: float) -> Shares:
        """Values in ``unit`` behind a lag, (count,), from the fine one of this number on."""
        before, mean = math.ceil(WARM_UP * lag_s * FINE_HZ), self._mean
        half = len(mean) // 2
        path = self._at((first + np.arange(-before - half, count + half)) / FINE_HZ)
        rounded = np.convolve(path, mean, "valid")
        return behind_lag(rounded, lag_s)[before:] if lag_s > 0 else rounded

    @cached_property
    def _mean(self) -> Shares:
        """Weights of the means: over a tick where the file has more rows than ticks, and over its corners."""
        over_tick = 1 / TICK_HZ if self.is_finer_than(1 / TICK_HZ) else 0.0
        return np.convolve(mean_weights(over_tick), mean_weights(self.rounding_s))

    def _late(self, t_s: Shares) -> Shares:
        """What the lag adds to what can be played, at times within a period, shape of ``t_s``."""
        place, late = np.atleast_1d(t_s) * FINE_HZ, np.zeros(np.size(t_s))
        if not place.size:
            return np.asarray(t_s, np.float64)
        for first, count in parts(math.floor(place.min()), math.floor(place.max()) + 2):
            inside = (first <= place) & (place < first + count)
            added = self._played(first, count + 1, self.lag_s) - self._played(first, count + 1, 0.0)
            late[inside] = np.interp(place[inside] - first, np.arange(count + 1), added)
        return late.reshape(np.shape(t_s))


def behind_lag(values: Shares, lag_s: float) -> Shares:
    """A path at the fine rate, joined by straight lines, behind a first-order lag, same shape; at rest before."""
    from scipy.signal import lfilter  # slow to load, and needed here only

    step = 1 / (FINE_HZ * lag_s)
    kept = math.exp(-step)
    mean = -math.expm1(-step) / step
    late, _ = lfilter([1 - mean, mean - kept], [1.0, -kept], values, zi=[mean * values[0]])
    return np.asarray(late)
