"""``path:scan.csv``, ``path:scan.csv@10Hz``: a file of any length, whose points go to the device while it is played."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from phaselead.errors import BadInput
from phaselead.waveforms.file import SAME_PERIOD, File, OwnPath, played_points
from phaselead.waveforms.path_file import Column, read_columns
from phaselead.waveforms.waveform import DEFAULT_PERIODS, Shares, Waveform
from phaselead.waveforms.written import Unit, Written, short

TICK_HZ = 5000
"""Of the device: no point is finer."""
NEAR = {"um": 0.002, "V": 0.0002}
"""So near to the file points must stay where fewer than one a tick are sent: under half a code of the converters."""
LOG2_MOST = 3
"""The fewest points are one every 2^3 ticks: the device then holds 1.6 s of the path."""
AVERAGED = 8
"""Samples of the path between two points where the file has more rows than that."""


@dataclass(frozen=True, eq=False)
class Streamed(Waveform):
    """Values of a file at times of its own, joined by straight lines. A run is judged by exactly that; the device plays
    points of it, one every ``2^log2`` ticks, which are the path's averages about them where the file has more rows."""

    times_s: Shares
    values: Shares
    """In ``unit``, shape of ``times_s``, which begin at 0."""

    kind = "path"
    written: ClassVar[tuple[tuple[str, str], ...]] = (
        ("path:scan.csv", "the file once, in its own time, of any length, a column an axis"),
        ("path:scan.csv@10Hz", "the same ten times a second"),
    )
    order = 4
    played_as = "points"
    periodic = False

    @classmethod
    def parse(cls, written: Written) -> Self:
        return cls.parse_axes(written, "x", named=True)["x"]  # type: ignore[return-value]

    @classmethod
    def parse_axes(cls, written: Written, axis: str, *, named: bool = False) -> dict[str, Waveform]:
        """The waveform of each axis that the file has a column of, or of ``axis`` alone."""
        path, at, _ = written.rest.rpartition("@")
        f_Hz = written.at_frequency()[1] if at else None
        columns = read_columns(path if at else written.rest)
        if named or None in columns:
            if axis not in columns and None not in columns:
                has = ", ".join(map(str, columns))
                raise BadInput(f"waveform {short(written.text)}: its file has no column of axis {axis}, only of {has}")
            return {axis: _of(written, columns.get(axis) or columns[None], f_Hz)}
        return {name: _of(written, column, f_Hz) for name, column in columns.items() if name is not None}

    def share(self, turns: Shares) -> Shares:
        return np.asarray((self._at(np.asarray(turns) / self.f_Hz) - self.offset) / self.swing)

    def _at(self, t_s: Shares) -> Shares:
        return np.interp(t_s, self.times_s, self.values)

    @property
    def steepest_share(self) -> float:
        return float(np.abs(np.diff(self.values) / np.diff(self.times_s)).max()) / self.swing / self.f_Hz

    def fastest(self, over_s: float) -> tuple[float, float]:
        # Between straight lines the way over so long is largest where it begins or ends at one's end.
        begins_s = np.concatenate([self.times_s, self.times_s - over_s])
        ways = np.abs(self._at(begins_s + over_s) - self._at(begins_s))
        largest = int(np.argmax(ways))
        return float(ways[largest]) / over_s, max(float(begins_s[largest]), 0.0)

    def scaled(self, *, swing: float = 1.0, time: float = 1.0) -> Self:
        values = self.offset + (self.values - self.offset) * swing
        return replace(super().scaled(swing=swing, time=time), times_s=self.times_s * time, values=values)

    def part(self, begin_s: float, seconds: float) -> Streamed:
        """So much of it, of a path that is driven once, as shares of the swing of the whole."""
        end_s = min(begin_s + seconds, self.duration_s)
        inside = (self.times_s > begin_s) & (self.times_s < end_s)
        times_s = np.concatenate([[begin_s], self.times_s[inside], [end_s]])
        return replace(self, f_Hz=1 / (end_s - begin_s), times_s=times_s - begin_s, values=self._at(times_s))

    @property
    def default_duration_s(self) -> float:
        return self.duration_s

    @property
    def path_s(self) -> float | None:
        return self.duration_s

    def last_rows(self, periods: int, rows: int, rate_Hz: float) -> slice:
        return slice(0, min(rows, round(self.duration_s * rate_Hz)))

    # ---------------------------------------------------------------- what the device plays

    def points_of(self, first: int, count: int, log2: int) -> Shares:
        """Shares of the swing at the points ``first`` and after, (count,), one every ``2^log2`` ticks; point 0 is the
        beginning. Before it and behind the end the path goes on as if it were turned about that end by half a turn, as
        far as its range allows, so that it keeps its speed while it is joined."""
        point_s = 2**log2 / TICK_HZ
        if not self.is_finer_than(point_s):
            return self._shares((first + np.arange(count)) * point_s)
        each = AVERAGED
        fine = self._shares((first * each + np.arange(1 - each, count * each)) * (point_s / each))
        weights = 1 - np.abs(np.arange(1 - each, each)) / each
        return np.convolve(fine, weights / weights.sum(), "valid")[::each]

    def is_finer_than(self, point_s: float) -> bool:
        """Whether it has rows that points so far apart cannot play."""
        return float(np.diff(self.times_s).min()) < point_s / 2

    def _shares(self, t_s: Shares) -> Shares:
        end_s = self.duration_s
        inside = np.abs(t_s)
        inside = np.where(t_s > end_s, np.maximum(2 * end_s - t_s, 0.0), inside)
        values = self._at(inside)
        values = np.where(t_s < 0, 2 * self.values[0] - values, values)
        values = np.where(t_s > end_s, 2 * self.values[-1] - values, values)
        return np.clip((values - self.offset) / self.swing, 0.0, 1.0)

    @cached_property
    def log2(self) -> int:
        """Of the ticks between two points: the most that leave the path by no more than is seen."""
        enough = max(self._left_by(0), NEAR[self.unit])
        return max(log2 for log2 in range(LOG2_MOST + 1) if self._left_by(log2) <= enough)

    @cached_property
    def unplayed(self) -> float:
        return self._left_by(self.log2)

    def _left_by(self, log2: int) -> float:
        """The largest difference between the file and the points, at the ticks and the rows."""
        point_s = 2**log2 / TICK_HZ
        points = self.points_of(0, int(self.duration_s / point_s) + 2, log2)
        ticks_s = np.arange(int(self.duration_s * TICK_HZ)) / TICK_HZ
        t_s = np.union1d(ticks_s, self.times_s[self.times_s <= self.duration_s])
        played = np.interp(t_s, np.arange(len(points)) * point_s, points)
        return float(np.abs(self._shares(t_s) - played).max()) * self.swing

    @property
    def judged_apart(self) -> bool:
        return True


@dataclass(frozen=True, eq=False)
class Repeated(Streamed):
    """The same over and over; the way from the last value back to the first takes one more row."""

    periodic = True

    def _at(self, t_s: Shares) -> Shares:
        return np.interp(t_s % self.duration_s, self.times_s, self.values)

    def _shares(self, t_s: Shares) -> Shares:
        return np.clip((self._at(t_s) - self.offset) / self.swing, 0.0, 1.0)

    @property
    def default_duration_s(self) -> float:
        return DEFAULT_PERIODS / self.f_Hz

    @property
    def path_s(self) -> float | None:
        return None

    def last_rows(self, periods: int, rows: int, rate_Hz: float) -> slice:
        return slice(-min(rows, round(periods / self.f_Hz * rate_Hz)), None)


def of_table(waveform: Waveform) -> Waveform:
    """The same path for what drives it from the 1024 points of a table; others are returned as they are."""
    if not isinstance(waveform, Repeated):
        return waveform
    own = OwnPath(waveform.times_s * waveform.f_Hz, (waveform.values - waveform.offset) / waveform.swing)
    return File(waveform.swing, waveform.offset, waveform.unit, waveform.f_Hz, played_points(own), own)


def _of(written: Written, column: Column, f_Hz: float | None) -> Streamed:
    times_s, values, unit = column
    swing, lowest = float(np.ptp(values)), float(values.min())
    if swing == 0:
        raise BadInput(f"path {written.rest}: its values are all {values[0]:g}; use goto to hold a position")
    if f_Hz is None:
        if times_s is None:
            raise written.refusal("the file has no column t_s; give a rate", f"path:{written.rest}@10Hz")
        return Streamed(swing, lowest, unit, 1 / float(times_s[-1]), times_s, values)
    return _repeated(written, times_s, values, unit, swing, lowest, f_Hz)


def _repeated(
    written: Written, times_s: Shares | None, values: Shares, unit: Unit, swing: float, lowest: float, f_Hz: float
) -> Repeated:
    if times_s is None:
        times_s = np.arange(len(values)) / len(values) / f_Hz
    own_s = float(times_s[-1]), float(times_s[-1]) * len(values) / (len(values) - 1)
    if not any(abs(f_Hz * period_s - 1) <= SAME_PERIOD for period_s in own_s):
        raise written.refusal(
            f"its times make a period of {own_s[1]:.6g} s, @{f_Hz:g}Hz one of {1 / f_Hz:.6g} s: take t_s out of the "
            "file to play it at another rate",
            f"{written.text.rpartition('@')[0]}@{1 / own_s[1]:.6g}Hz",
        )
    scaled = times_s / (own_s[1] * f_Hz)
    return Repeated(swing, lowest, unit, f_Hz, np.append(scaled, 1 / f_Hz), np.append(values, values[0]))
