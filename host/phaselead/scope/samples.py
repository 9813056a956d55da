"""The last minute of every tick of all axes, and what of it a screen can show."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phaselead.device import TICK_HZ, Gap, LiveSamples

TRACES = ("r_um", "x_um", "e_um", "u_V", "ff_V", "fb_V")
"""Reference, position, error = reference - position, output, its part from feed-forward, and from feedback."""
KEPT_S = 60.0
DROPS_KEPT = 1000
Values = NDArray[np.float32]


@dataclass
class Samples:
    """A ring by tick; NaN where a tick did not come. One thread adds, others look: every call holds ``lock``."""

    axes: str = "xyz"
    seconds: float = KEPT_S
    end: int = 0
    """First tick that has not come yet."""
    begin: int = 0
    """First tick that is, or was to be, in the ring."""
    dropped: int = 0
    """Ticks that were to come and did not, since the beginning."""
    drops: deque[Gap] = field(default_factory=lambda: deque(maxlen=DROPS_KEPT))
    lock: threading.RLock = field(default_factory=threading.RLock)

    def __post_init__(self) -> None:
        self.capacity = round(self.seconds * TICK_HZ)
        self._ring = np.full((len(self.axes), len(TRACES), self.capacity), np.nan, np.float32)

    def add(self, part: LiveSamples) -> None:
        """The next ticks. Ticks that go back, of a device that has restarted, begin anew."""
        with self.lock:
            empty = self.begin == self.end
            if empty or part.first_tick < self.end or part.first_tick - self.end > self.capacity:
                self._ring[:] = np.nan
                self.begin = self.end = part.first_tick
                self.drops.clear()
            if part.first_tick > self.end:
                self._put(self.end, np.full((*self._ring.shape[:2], part.first_tick - self.end), np.nan, np.float32))
            if part.missing:
                self.dropped += part.missing
                self.drops.append(Gap(part.first_tick - part.missing, part.missing))
            values = np.full((*self._ring.shape[:2], part.ticks), np.nan, np.float32)
            for i, axis in enumerate(self.axes):
                if axis in part.axes:
                    one = part.axes[axis]
                    values[i] = one.r_um, one.x_um, one.r_um - one.x_um, one.u_V, one.ff_V, one.fb_V
            self._put(part.first_tick, values[..., -self.capacity :])
            self.end = part.first_tick + part.ticks
            self.begin = max(self.begin, self.end - self.capacity)

    def _put(self, first: int, values: Values) -> None:
        at = first % self.capacity
        head = min(values.shape[-1], self.capacity - at)
        self._ring[..., at : at + head] = values[..., :head]
        self._ring[..., : values.shape[-1] - head] = values[..., head:]

    def rows(self, first: int, ticks: int) -> Values:
        """Every tick of a stretch, shape (axes, traces, ticks); NaN where there is none."""
        with self.lock:
            wanted = np.arange(first, first + ticks)
            found: Values = self._ring[..., wanted % self.capacity]
            found[..., (wanted < self.begin) | (wanted >= self.end)] = np.nan
            return found

    def envelope(self, first: int, columns: int, ticks: int) -> tuple[Values, Values]:
        """Lowest and highest value of every stretch of so many ticks, shape (axes, traces, columns) each; NaN where
        nothing of it has come. No extreme is left out, however narrow."""
        rows = self.rows(first, columns * ticks).reshape(len(self.axes), len(TRACES), columns, ticks)
        return np.fmin.reduce(rows, axis=-1), np.fmax.reduce(rows, axis=-1)

    def dropped_in(self, first: int, columns: int, ticks: int) -> NDArray[np.uint8]:
        """Which stretches lack ticks that were to come, shape (columns,): 0 or 1."""
        found = np.zeros(columns, np.uint8)
        with self.lock:
            for gap in self.drops:
                low, high = (gap.first_tick - first) // ticks, -(-(gap.first_tick + gap.ticks - first) // ticks)
                found[max(low, 0) : max(high, 0)] = 1
        return found
