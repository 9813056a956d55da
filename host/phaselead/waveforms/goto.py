"""``goto:120um``, ``goto:120um@0.5s``: a move without jerk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from phaselead.waveforms.edges import least_jerk
from phaselead.waveforms.waveform import Shares, Waveform
from phaselead.waveforms.written import Unit, Written

SPEED = {"um": 1000.0, "V": 50.0}
"""Peak speed of a move without a duration, per second: about what parking does."""
SHORTEST_MOVE_s = 0.05
PEAK_SPEED = 1.875
"""Of the least-jerk move, in ways per duration."""
SETTLE_S = 1.0
"""What a move is watched for after it has ended, unless a duration is given."""


@dataclass(frozen=True, eq=False)
class Goto(Waveform):
    """A least-jerk move: ``swing`` is the way to go, signed, ``offset`` where it starts. It stays at its ends."""

    asked: bool = False
    """The duration was asked for: it is kept, or refused."""

    kind = "goto"
    written: ClassVar[tuple[tuple[str, str], ...]] = (
        ("goto:120um", "from where the axis is to 120 um, without jerk, at 1000 um/s at most"),
        ("goto:120um@0.5s", "the same in 0.5 s"),
    )
    order = 4
    played_as = "move"
    periodic = False

    @classmethod
    def parse(cls, written: Written) -> Self:
        target_text, at, duration_text = written.rest.partition("@")
        target, unit = written.level(target_text)
        duration_s = written.duration_s(duration_text, "goto:120um@0.5s") if at else move_duration_s(target, unit)
        return cls(target, 0.0, unit, 1 / duration_s, bool(at))

    def share(self, turns: Shares) -> Shares:
        return least_jerk(turns)

    @property
    def steepest_share(self) -> float:
        return PEAK_SPEED

    @property
    def default_duration_s(self) -> float:
        return self.duration_s + SETTLE_S

    @property
    def path_s(self) -> float | None:
        return self.duration_s

    def last_rows(self, periods: int, rows: int, rate_Hz: float) -> slice:
        return slice(None)

    def from_start(self, start: float) -> Goto:
        """A move to the same target from ``start``: in the duration that was asked for, else at the usual speed."""
        way = self.offset + self.swing - start
        duration_s = self.duration_s if self.asked else move_duration_s(way, self.unit)
        return replace(self, swing=way, offset=start, f_Hz=1 / duration_s)


def move_duration_s(way: float, unit: Unit) -> float:
    """Duration of a least-jerk move of this way at a safe peak speed."""
    return max(SHORTEST_MOVE_s, PEAK_SPEED * abs(way) / SPEED[unit])
