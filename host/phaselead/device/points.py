"""Points of a path on their way to the device while it plays it (docs/firmware.md, "Paths one after another")."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phaselead.device import wire
from phaselead.device.quantities import TICK_HZ, WAVE_POINTS
from phaselead.device.session import Refused, Session
from phaselead.device.stream import AXES, mask_of
from phaselead.errors import BadInput

LOG2_MOST = 8
ONE = 2**30
WORTH_A_FRAME = 64
"""Points; fewer wait for more room."""
SPARE = 2
"""The device looks at the point before and the one after."""
ROOM_FOR_JOIN = WAVE_POINTS // 2
"""Of the points of the ring that the join into a path may take: the rest is what is ahead."""

Points = Callable[[int, int], NDArray[np.float64]]
"""Shares of the swing, (count,), of ``count`` points from the one of this number on; the path begins at point 0."""


@dataclass
class PointFeeder:
    """Sends the points of some axes: ``begin`` before their paths are set, ``feed`` again and again while they run."""

    session: Session
    points: Mapping[str, Points]
    """By axis."""
    log2: int
    """A point is played every ``2^log2`` ticks."""
    steepest: Mapping[str, float]
    """The largest step between two points, share of the swing."""
    enter_ticks: int
    """Of the longest join into the paths."""
    length_ticks: int
    tail_ticks: int
    """Of the joins out of them and the looks ahead."""
    dry_tick: int | None = None
    """In which the path ended for want of points."""
    over: bool = False
    """The device takes no more."""
    next: int = field(init=False)
    """Number of the next point to be sent."""
    room: int = WAVE_POINTS

    def __post_init__(self) -> None:
        self.next = self.first = -math.ceil(self.enter_ticks / 2**self.log2) - SPARE
        self.last = math.ceil((self.length_ticks + self.tail_ticks) / 2**self.log2) + SPARE
        """The last point that can be asked for."""
        self.axes = "".join(axis for axis in AXES if axis in self.points)

    @property
    def period_Hz(self) -> float:
        """Of a waveform of 1024 points, which is what the device takes the ring for."""
        return TICK_HZ / (WAVE_POINTS << self.log2)

    def begin(self) -> None:
        """Makes the waveforms of the axes rings, and fills them. Raises BadInput, Refused."""
        if -self.first > ROOM_FOR_JOIN:
            raise BadInput(
                f"the way into the path takes {self.enter_ticks / TICK_HZ:.2g} s, at most "
                f"{ROOM_FOR_JOIN * 2**self.log2 / TICK_HZ:.2g} s are possible before a path of points; go to its "
                "beginning first, or begin it where the axis stands"
            )
        steps = tuple(min(ONE, math.ceil(self.steepest.get(axis, 0.0) * ONE) + 2) for axis in AXES)
        self.session.request(wire.PointsBeginRequest(mask_of(self.axes), self.log2, self.first, steps))
        self.feed()

    def feed(self) -> None:
        """Sends as many points as there is room for now. A path that has run dry is left alone: ``dry_tick`` says so.

        Raises Refused and LinkError as every command.
        """
        most = (wire.MAX_PAYLOAD - wire.PointsRequest.SIZE) // 4 // len(self.axes)
        if self.over or self.next > self.last:
            return
        try:
            self._send(0)
            for _ in range(min(self.room, self.last + 1 - self.next) // most + 1):
                count = min(most, self.room, self.last + 1 - self.next)
                if count < min(WORTH_A_FRAME, self.last + 1 - self.next):
                    break
                self._send(count)
        except Refused as refusal:
            if refusal.status == wire.Status.FAULT_LATCHED:
                return  # whoever captures hears which
            if refusal.status != wire.Status.WRONG_STATE:
                raise
            self._find_out()

    def _find_out(self) -> None:
        self.over = True
        found, at = self.session.request(wire.WhereRequest()), AXES.index(self.axes[0])
        if found.dry & mask_of(self.axes):
            self.dry_tick = found.dry_ticks[at]

    def _send(self, count: int) -> None:
        values = [self.points[axis](self.next, count) if count else np.empty(0) for axis in self.axes]
        data = np.rint(np.concatenate(values) * ONE).astype("<i4").tobytes()
        reply = self.session.request(wire.PointsRequest(mask_of(self.axes), self.next, self.length_ticks, data))
        self.next, self.room = self.next + count, reply.room
