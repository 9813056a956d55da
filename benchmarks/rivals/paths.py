"""The eight paths of the comparison, scaled to each stage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Samples = NDArray[np.float64]
ROWS = 1024
"""Of a period that is given as a file: as many as the device plays."""


@dataclass(frozen=True)
class Path:
    """A periodic path from 0 to ``swing_um``, ``shape`` as shares of the swing over one period, and how many periods a
    run takes. ``sine``: it is one."""

    name: str
    swing_um: float
    f_Hz: float
    shape: Callable[[Samples], Samples]
    periods: int = 10
    sine: bool = False

    def __call__(self, t_s: ArrayLike) -> Samples:
        """um at these times, same shape."""
        return self.swing_um * self.shape(np.asarray(t_s, np.float64) * self.f_Hz % 1.0)

    @property
    def seconds(self) -> float:
        return self.periods / self.f_Hz

    def scaled(self, swing: float, pace: float) -> Path:
        return Path(self.name, swing * self.swing_um, pace * self.f_Hz, self.shape, self.periods, self.sine)

    def rows(self) -> Samples:
        """One period for a file, um (1024,)."""
        return self(np.arange(ROWS) / (ROWS * self.f_Hz))


def _by_rows(values: Samples) -> Callable[[Samples], Samples]:
    """Of points of one period, joined by straight lines, stretched from 0 to 1."""
    closed = np.append(values, values[0])
    closed = (closed - closed.min()) / np.ptp(closed)
    return lambda turns: np.interp(turns * len(values), np.arange(len(values) + 1), closed)


def _sine(turns: Samples) -> Samples:
    return np.asarray((1 - np.cos(2 * np.pi * turns)) / 2)


def _least_jerk(s: Samples) -> Samples:
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def _rounded_triangle(share: float = 0.05) -> Samples:
    """Corners are parabolas over ``share`` of the period."""
    corners = 1 - np.abs(2 * np.arange(ROWS) / ROWS - 1)
    return np.asarray(np.fft.irfft(np.fft.rfft(corners) * np.sinc(share * np.arange(ROWS // 2 + 1)), ROWS))


def _raster_line(line: float = 0.75) -> Samples:
    """A line at constant speed over ``line`` of the period, and back so that speed and acceleration do not jump."""
    turns = np.arange(ROWS) / ROWS
    back = (turns - line) / (1 - line)
    speed = (1 - line) / line  # of the line, in units of the way back
    returned = 1 + speed * back - (1 + speed) * _least_jerk(back)
    return np.roll(np.where(turns < line, turns / line, returned), 0)


def _stairs(levels: int = 5, edge: float = 0.1) -> Samples:
    """Up and down again in equal steps, each a least-jerk edge in ``edge`` of its time."""
    heights = np.concatenate([np.arange(1, levels + 1), np.arange(levels)[::-1]]) / levels
    place = np.arange(ROWS) / ROWS * len(heights)
    at = place.astype(int)
    before = heights[at - 1]
    return np.asarray(before + (heights[at] - before) * _least_jerk((place - at) / edge))


def _two_tones(second: float = 0.05, times: int = 16) -> Samples:
    turns = np.arange(ROWS) / ROWS
    return _sine(turns) + second * _sine(times * turns)


PATHS = (
    Path("sine 60 um 5 Hz", 60.0, 5.0, _sine, sine=True),
    Path("sine 60 um 20 Hz", 60.0, 20.0, _sine, 20, sine=True),
    Path("sine 30 um 100 Hz", 30.0, 100.0, _sine, 100, sine=True),
    Path("sine 10 um 200 Hz", 10.0, 200.0, _sine, 200, sine=True),
    Path("rounded triangle 30 um 50 Hz", 30.0, 50.0, _by_rows(_rounded_triangle()), 50),
    Path("raster line 60 um 10 Hz", 60.0, 10.0, _by_rows(_raster_line()), 10),
    Path("staircase 50 um, 5 steps, 2 Hz", 50.0, 2.0, _by_rows(_stairs()), 5),
    Path("two tones 40 um 5 Hz, 2 um 80 Hz", 42.0, 5.0, _by_rows(_two_tones())),
)
"""As they are on a stage of 250 um with its first mode at 200 Hz."""

SCALES = {"xyz250": (1.0, 1.0), "xyz250-hard": (1.0, 1.0), "xy30": (0.12, 2.0), "x100": (0.4, 2.0), "x500": (2.0, 0.4)}
"""Swing by travel, and pace by first mode, of each stage against that one; not above twice the pace, since ticks are
the same."""


def paths_for(stage: str) -> list[Path]:
    """Scaled to a built-in stage."""
    return [path.scaled(*SCALES[stage]) for path in PATHS]
