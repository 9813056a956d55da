"""What a waveform is: a reference path of one axis. Each kind is a class in a file of its own beside this one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phaselead.waveforms.written import Unit, Written

POINTS = 1024
"""Of one period of a waveform that the device plays from a table."""
JUDGED_PERIODS = 4
"""Tracking figures of a periodic path are over so many of its last periods."""
DEFAULT_PERIODS = 10

Shares = NDArray[np.float64]
"""Of the swing, 0 to 1."""


@dataclass(frozen=True, eq=False)
class Waveform(ABC):
    """A reference path of one axis, from ``offset`` by ``swing`` (peak-to-peak), both in ``unit``.

    A kind of waveform is a subclass with a ``kind``; it is found by its file. ``f_Hz`` is 1 / ``duration_s``.
    """

    swing: float
    offset: float
    unit: Unit
    f_Hz: float

    kind: ClassVar[str]
    """The word before the colon."""
    written: ClassVar[tuple[tuple[str, str], ...]]
    """Ways to write it and what they mean, for help and docs; messages show the first."""
    order: ClassVar[int] = 100
    """Its place among the kinds."""
    played_as: ClassVar[Literal["sine", "wave", "move", "points"]]
    """The path of the device that plays it; a "wave" is uploaded as ``points``, "points" come while it is played."""
    periodic: ClassVar[bool]
    jumps: ClassVar[bool] = False
    """Whether it is there for what a stage does that is asked for more than it can."""

    @classmethod
    @abstractmethod
    def parse(cls, written: Written) -> Self:
        """The waveform that a user wrote. Raises BadInput."""

    @classmethod
    def parse_axes(cls, written: Written, axis: str, *, named: bool = False) -> dict[str, Waveform]:
        """The same by axis; a kind that gives several axes their waveforms gives that of ``axis`` alone where that was
        ``named``. Raises BadInput."""
        return {axis: cls.parse(written)}

    @abstractmethod
    def share(self, turns: Shares) -> Shares:
        """Values as shares of the swing at ``turns`` periods (or durations) from the start, same shape."""

    @property
    @abstractmethod
    def steepest_share(self) -> float:
        """Largest slope of ``share``, per period or duration."""

    @property
    @abstractmethod
    def default_duration_s(self) -> float:
        """How long it is driven when nobody says."""

    @abstractmethod
    def last_rows(self, periods: int, rows: int, rate_Hz: float) -> slice:
        """The last ``periods`` periods of a record of ``rows`` samples; of a path without periods, all of it."""

    @property
    def points(self) -> Shares | None:
        """One period as shares of the swing, shape (1024,), for the device to play; None when it needs none."""
        return None

    @property
    def unplayed(self) -> float:
        """The largest difference, in ``unit``, between the path and what the device plays of it."""
        return 0.0

    @property
    def as_asked(self) -> Waveform:
        """The path that a user asked for: this one, unless it is played in place of another."""
        return self

    @property
    def judged_apart(self) -> bool:
        """Whether a run is judged by ``value`` and not by what the device played."""
        return self.unplayed > 0

    @property
    def path_s(self) -> float | None:
        """How long the path takes; None: as long as it is driven."""
        return None

    @property
    def duration_s(self) -> float:
        """Of one period, or of a move."""
        return 1 / self.f_Hz

    @property
    def lowest(self) -> float:
        return min(self.offset, self.offset + self.swing)

    @property
    def highest(self) -> float:
        return max(self.offset, self.offset + self.swing)

    def value(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """Values in ``unit`` at times from the start, shape of ``t_s``."""
        turns = np.asarray(t_s, dtype=np.float64) * self.f_Hz
        return np.asarray(self.offset + self.swing * self.share(turns))

    def playable(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """The same of what the device can play of it."""
        return self.value(t_s)

    def steepest(self) -> float:
        """Largest rate, in units per second."""
        return self.steepest_share * abs(self.swing) * self.f_Hz

    def fastest(self, over_s: float) -> tuple[float, float]:
        """Largest rate over so long, in units per second, and where it begins, in seconds from the start (a periodic
        path: 0)."""
        return self.steepest(), 0.0

    def scaled(self, *, swing: float = 1.0, time: float = 1.0) -> Self:
        """The same with so many times the swing, from the same offset, in so many times the time."""
        return replace(self, swing=self.swing * swing, f_Hz=self.f_Hz / time)

    def judged_rows(self, rows: int, rate_Hz: float) -> slice:
        """The part of a record of ``rows`` samples that tracking figures are over."""
        return self.last_rows(JUDGED_PERIODS, rows, rate_Hz)

    def from_start(self, start: float) -> Waveform:
        """The path begun where the axis stands, for those that begin anywhere; others are returned as they are."""
        return self


@dataclass(frozen=True, eq=False)
class Periodic(Waveform):
    """A path that repeats, written ``KIND:SWING[+OFFSET]@FREQUENCY``. A new kind needs ``shape`` and its words.

    The device plays 1024 points a period, joined by straight lines, and so does ``share``.
    """

    played_as: ClassVar[Literal["sine", "wave", "move", "points"]] = "wave"
    periodic = True

    @classmethod
    def parse(cls, written: Written) -> Self:
        body, f_Hz = written.at_frequency()
        swing, offset, unit = written.levels(body)
        if swing <= 0:
            raise written.refusal(f"its swing {swing:g} {unit} must be above 0 (peak-to-peak)")
        return cls(swing, offset, unit, f_Hz)

    @abstractmethod
    def shape(self, turns: Shares) -> Shares:
        """One period as shares of the swing, at ``turns`` from 0 to 1, same shape; it begins at 0."""

    @cached_property
    def points(self) -> Shares | None:
        return self.shape(np.arange(POINTS) / POINTS)

    def share(self, turns: Shares) -> Shares:
        return np.interp(turns % 1.0 * POINTS, np.arange(POINTS + 1), self._closed())

    @property
    def steepest_share(self) -> float:
        return float(np.abs(np.diff(self._closed())).max()) * POINTS

    def fastest(self, over_s: float) -> tuple[float, float]:
        if over_s * self.f_Hz * POINTS <= 1 or self.points is None:
            return self.steepest(), 0.0
        over = over_s * self.f_Hz * POINTS
        begins = np.concatenate([np.arange(POINTS), np.arange(POINTS) - over])
        first, last = (
            np.interp(places % POINTS, np.arange(POINTS + 1), self._closed()) for places in (begins, begins + over)
        )
        return float(np.abs(last - first).max()) * abs(self.swing) / over_s, 0.0

    def _closed(self) -> Shares:
        """The points and the first one again, shape (1025,)."""
        assert self.points is not None
        return np.append(self.points, self.points[0])

    @property
    def default_duration_s(self) -> float:
        return DEFAULT_PERIODS / self.f_Hz

    def last_rows(self, periods: int, rows: int, rate_Hz: float) -> slice:
        return slice(-min(rows, round(periods / self.f_Hz * rate_Hz)), None)


@dataclass(frozen=True, eq=False)
class Sampled(Periodic):
    """A periodic path given by its points, ``period``, shares of the swing, shape (1024,)."""

    period: Shares

    def shape(self, turns: Shares) -> Shares:
        return np.interp(turns * POINTS, np.arange(POINTS), self.period)

    @property
    def points(self) -> Shares:
        return self.period
