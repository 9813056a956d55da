"""``file:path.csv@10Hz``: one period from a file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from phaselead.errors import BadInput
from phaselead.waveforms.path_file import TIMES, read_numbers, unit_of_column
from phaselead.waveforms.waveform import POINTS, Sampled, Shares
from phaselead.waveforms.written import Unit, Written

SAME_PERIOD = 0.01
"""Relative difference up to which the times of a file agree with the frequency that was asked for: times are printed
rounded, and uniform means within 1 % everywhere."""


class OwnPath(NamedTuple):
    """One period as the file has it, joined by straight lines: turns from 0 to 1 and shares of the swing, (n + 1,)."""

    turns: Shares
    shares: Shares

    def __call__(self, turns: Shares) -> Shares:
        return np.asarray(np.interp(turns % 1.0, self.turns, self.shares))


@dataclass(frozen=True, eq=False)
class File(Sampled):
    """The values of a file; the lowest is the offset. The device plays 1024 points of it, joined by straight lines: a
    run is judged by the file's own path, ``own``."""

    own: OwnPath

    kind = "file"
    written = (("file:path.csv@10Hz", "the file is one period, ten times a second"),)
    order = 3

    @classmethod
    def parse(cls, written: Written) -> Self:
        path, f_Hz = written.at_frequency()
        lowest, swing, unit, own, own_s = read_period(path)
        if own_s is not None and not any(abs(f_Hz * period_s - 1) <= SAME_PERIOD for period_s in own_s):
            raise written.refusal(
                f"its times make a period of {own_s[-1]:.6g} s, @{f_Hz:g}Hz one of {1 / f_Hz:.6g} s: take t_s out of "
                "the file to play it at another rate",
                f"file:{path}@{1 / own_s[-1]:.6g}Hz",
            )
        return cls(swing, lowest, unit, f_Hz, played_points(own), own)

    def share(self, turns: Shares) -> Shares:
        return self.own(turns)

    def playable(self, t_s: ArrayLike) -> Shares:
        points = Sampled.share(self, np.asarray(t_s, dtype=np.float64) * self.f_Hz)
        return np.asarray(self.offset + self.swing * points)

    @cached_property
    def unplayed(self) -> float:
        return self.swing * largest_difference(self.own, self.period)


def of_points(values: ArrayLike, unit: Unit, f_Hz: float) -> File:
    """One period given by its values, shape (n,), n at least 2, at equal distances, joined by straight lines."""
    points = np.asarray(values, np.float64)
    lowest, swing = float(points.min()), float(np.ptp(points))
    own = OwnPath(np.arange(len(points) + 1) / len(points), (np.append(points, points[0]) - lowest) / swing)
    return File(swing, lowest, unit, f_Hz, played_points(own), own)


def played_points(own: OwnPath) -> Shares:
    """1024 points of the path (1024,): those on it or, of a file with more rows, the path averaged about each;
    whichever, joined by straight lines, stays nearer to it."""
    on_path = np.clip(own(np.arange(POINTS) / POINTS), 0.0, 1.0)
    if len(own.turns) <= POINTS + 1:
        return on_path
    each = max(8, math.ceil(2 * len(own.turns) / POINTS))
    fine = own(np.arange(POINTS * each) / (POINTS * each))
    weights = 1 - np.abs(np.arange(1 - each, each)) / each
    around = (np.arange(POINTS)[:, None] * each + np.arange(1 - each, each)) % len(fine)
    averaged = np.clip(fine[around] @ (weights / weights.sum()), 0.0, 1.0)
    return min((on_path, averaged), key=lambda points: largest_difference(own, points))


def largest_difference(own: OwnPath, points: Shares) -> float:
    """Between the path and the points (1024,) joined by straight lines, at every bend of either, share of the swing."""
    places = np.concatenate([own.turns, np.arange(POINTS) / POINTS])
    played = np.interp(places * POINTS, np.arange(POINTS + 1), np.append(points, points[0]))
    return float(np.abs(own(places) - played).max())


def read_period(path: str) -> tuple[float, float, Unit, OwnPath, tuple[float, float] | None]:
    """One period from a file: a column of values, or times and values; a header may name them, with their units.

    Lowest value, swing, unit, the path and, of a file with a column of times, how long it takes without and with the
    way from its last row back to its first, s.
    """
    source = f"waveform file {path}"
    layout = f"one column of values, or times and values; path:{path} drives a column an axis"
    labels, rows = read_numbers(path, source, "one period", layout, 2)
    unit: Unit = "um"
    values, timed = rows[:, -1], bool(labels) and labels[0] in TIMES
    if labels:
        if labels[-1] in TIMES or (len(labels) == 2 and not timed):
            raise BadInput(f"{source}: its columns are {','.join(labels)}; one period is {layout}, as in t_s,x_um")
        _, unit, scale = unit_of_column(labels[-1], source)
        with np.errstate(over="ignore"):
            values = values * scale
    times = np.arange(len(rows), dtype=np.float64)
    if rows.shape[1] == 2:
        times = rows[:, 0] * (TIMES[labels[0]] if timed else 1.0)
        if (np.diff(times) <= 0).any():
            raise BadInput(
                f"{source}: row {int(np.argmax(np.diff(times) <= 0)) + 2}: time does not advance; sort the rows"
            )
    with np.errstate(over="ignore", invalid="ignore"):
        period = times[-1] - times[0] + (times[-1] - times[0]) / (len(times) - 1)
        swing = float(np.ptp(values))
    if not (np.isfinite(period) and np.isfinite(swing)):
        raise BadInput(f"{source}: its numbers are too large; check their unit")
    if swing == 0:
        raise BadInput(f"{source}: its values are all {values[0]:g}; use goto to hold a position")
    lowest = float(values.min())
    shares = (np.append(values, values[0]) - lowest) / swing
    own_s = (float(times[-1] - times[0]), float(period)) if timed else None
    return lowest, swing, unit, OwnPath(np.append((times - times[0]) / period, 1.0), shares), own_s
