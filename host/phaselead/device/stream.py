"""Sample batches as arrays, with every gap accounted for, and what a capture consists of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phaselead.device import wire
from phaselead.errors import LinkError

AXES = "xyz"
ALL_CHANNELS = sum(channel for channel in wire.Channel if channel.name != "TRIGGER")
"""Of the axes. What the device's triggers do costs a byte more a tick and axis: only where they are in use."""
HEAD = np.dtype(
    [
        ("type", "u1"),
        ("id", "<u2"),
        ("session", "<u8"),
        ("sequence", "<u4"),
        ("first_tick", "<u8"),
        ("dropped", "<u4"),
        ("channels", "u1"),
        ("axis_mask", "u1"),
        ("decimation", "<u2"),
    ]
)
"""Header and fixed part of a samples message."""
RESTARTED = "the samples run backwards; the device has restarted: start the capture again"
assert HEAD.itemsize == wire.HEADER.size + wire.Samples.SIZE


@dataclass(frozen=True)
class AxisStream:
    """Raw numbers of one axis, shape (n,) each; None where the channel was not asked for."""

    reference: NDArray[np.int32] | None = None
    """um q16, in mode open V q24."""
    adc: NDArray[np.uint16] | None = None
    dac: NDArray[np.uint16] | None = None
    feedforward: NDArray[np.int16] | None = None
    """V q11."""
    feedback: NDArray[np.int16] | None = None
    """V q11."""
    trigger: NDArray[np.uint8] | None = None
    """Of the device: bits 0 to 2 for an output that pulses in the tick, bit 7 for an edge at the input."""


@dataclass(frozen=True)
class Gap:
    """Ticks that should have been recorded and were not."""

    first_tick: int
    ticks: int


@dataclass(frozen=True)
class Stream:
    """Batches of one stream, joined. ``ticks`` has shape (n,); steps above ``decimation`` are gaps."""

    ticks: NDArray[np.int64]
    axes: dict[str, AxisStream]
    channels: int = ALL_CHANNELS
    axis_mask: int = 0
    decimation: int = 1
    gaps: list[Gap] = field(default_factory=list)
    lost_batches: int = 0
    """Batches the device sent that never came, by their sequence numbers; without those after the last that did."""
    dropped_ticks: int = 0
    """Ticks the device says it could not send."""


@dataclass(frozen=True)
class Capture:
    """A stretch of ticks and all that is needed to run it again.

    ``command_log`` holds (tick before which it took effect, frame) of every command answered after the stream
    began; ``state`` is the device's control state at ``first_tick``, as SNAPSHOT_READ gives it.
    """

    hello: wire.HelloReply
    session: int
    stream: Stream
    first_tick: int
    start_tick: int
    """The paths began before this tick; -1 when the capture started none."""
    end_tick: int
    """First tick beyond those asked for; the ticks from here on are the way to park."""
    state: bytes
    model: bytes | None
    waves: dict[str, bytes]
    command_log: list[tuple[int, bytes]]
    events: list[wire.Event]
    status: wire.StatusReply
    """Of the end, before the stream was stopped."""
    tick_0_unix_s: float | None = None
    """Unix time of tick 0; None where no clock is known."""
    rows_end: int = 0
    """First tick beyond the last row that the device took or dropped."""

    @property
    def ticks(self) -> NDArray[np.int64]:
        return self.stream.ticks

    @property
    def axes(self) -> dict[str, AxisStream]:
        return self.stream.axes

    @property
    def gaps(self) -> list[Gap]:
        return self.stream.gaps

    @property
    def recorded_from(self) -> int:
        """The tick at which its recording begins: where the paths do, unless a fault came on the way to them."""
        on_the_way = self.status.fault and self.status.fault_tick < self.start_tick
        return self.first_tick if self.start_tick < 0 or on_the_way else self.start_tick

    @property
    def missing(self) -> int:
        """Rows between ``recorded_from`` and ``end_tick`` that are in a gap: dropped by the device or lost on the
        line."""
        begin, end = self.recorded_from, self.end_tick
        spans = ((max(gap.first_tick, begin), min(gap.first_tick + gap.ticks, end)) for gap in self.gaps)
        return sum(max(0, end - start) for start, end in spans) // self.stream.decimation


def axes_of(mask: int) -> str:
    """The letters of an axis mask, in order."""
    return "".join(letter for i, letter in enumerate(AXES) if mask >> i & 1)


def mask_of(axes: str) -> int:
    """The axis mask of these letters."""
    return sum(1 << AXES.index(axis) for axis in axes)


def tick_dtype(channels: int, axis_mask: int) -> np.dtype[np.void]:
    """Layout of one tick: for each axis of the mask the chosen channels."""
    names = [c.name.lower() for c in wire.Channel if channels & c]
    one = np.dtype([(name, wire.CHANNEL_DTYPES[name]) for name in names])
    return np.dtype([(axis, one) for axis in axes_of(axis_mask)])


def decode_samples(
    bodies: Sequence[bytes],
    first_tick: int | None = None,
    sent: int | None = None,
    dropped: int = 0,
    decimation: int = 1,
) -> Stream:
    """Joins sample batches (bodies of frames, in any order, some perhaps twice) into arrays.

    ``first_tick`` is the tick of the STREAM_START reply, so that a first batch that never came is a gap too; batches
    of before are of another stream and left out. ``sent`` and ``dropped`` are the rows that STREAM_STOP says were sent
    and were not, so that every row since is either here or in a gap. ``decimation`` counts when there is no batch.

    Raises:
        LinkError: the batches are not of one stream, contradict each other, or hold part of a tick.
    """
    if bodies and min(map(len, bodies)) < HEAD.itemsize:
        raise LinkError("a samples batch is shorter than its head; the device's firmware is at fault")
    heads = np.frombuffer(b"".join([body[: HEAD.itemsize] for body in bodies]), HEAD)
    order = np.argsort(heads["first_tick"], kind="stable")
    if first_tick is not None:
        order = order[heads["first_tick"][order] >= first_tick]
    order = _once(bodies, heads, order)
    heads = heads[order]
    if len(heads) == 0:
        return Stream(
            np.empty(0, np.int64), {}, gaps=_gaps(np.empty(0, np.int64), decimation, first_tick, sent, dropped)
        )
    channels, mask, decimation = (int(heads[name][0]) for name in ("channels", "axis_mask", "decimation"))
    same = (heads["channels"] == channels) & (heads["axis_mask"] == mask) & (heads["decimation"] == decimation)
    layout = tick_dtype(channels, mask)
    sizes = np.array([len(bodies[i]) for i in order]) - HEAD.itemsize
    if not same.all() or decimation == 0 or layout.itemsize == 0 or (sizes % layout.itemsize).any():
        raise LinkError("the samples batches do not belong to one stream; start the capture again")
    data = np.frombuffer(b"".join([bodies[i][HEAD.itemsize :] for i in order]), layout)
    ticks = _ticks(heads["first_tick"].astype(np.int64), sizes // layout.itemsize, decimation)
    axes = {
        axis: AxisStream(**{name: data[axis][name].copy() for name in data[axis].dtype.names or ()})
        for axis in layout.names or ()
    }
    steps = np.diff(heads["sequence"])  # wraps around with its uint32
    lost = int(np.sum(steps.astype(np.int64) - 1)) + int(heads["sequence"][0] if first_tick is not None else 0)
    gaps = _gaps(ticks, decimation, first_tick, sent, dropped)
    return Stream(ticks, axes, channels, mask, decimation, gaps, lost, max(dropped, int(heads["dropped"][-1])))


def _once(bodies: Sequence[bytes], heads: NDArray[np.void], order: NDArray[np.intp]) -> NDArray[np.intp]:
    """The batches in this order, copies left out. Raises LinkError where two are of one tick and yet not the same."""
    first, sequence = heads["first_tick"][order], heads["sequence"][order]
    again = np.zeros(len(order), bool)
    again[1:] = first[1:] == first[:-1]
    for i in np.flatnonzero(again):
        if bodies[order[i]] != bodies[order[i - 1]]:
            raise LinkError(RESTARTED)
    if (np.diff(sequence[~again]).astype(np.int32) <= 0).any():
        raise LinkError(RESTARTED)
    return order[~again]


def _ticks(first: NDArray[np.int64], counts: NDArray[np.int64], decimation: int) -> NDArray[np.int64]:
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    ticks: NDArray[np.int64] = np.repeat(first, counts) + within * decimation
    if len(ticks) > 1 and (np.diff(ticks) <= 0).any():
        raise LinkError(RESTARTED)
    return ticks


def _gaps(
    ticks: NDArray[np.int64], decimation: int, first_tick: int | None, sent: int | None, dropped: int
) -> list[Gap]:
    """Every row between the first that was to come and the last that is not in ``ticks``."""
    if first_tick is not None:
        ticks = np.append(first_tick - decimation, ticks)
        if sent is not None:
            ticks = np.append(ticks, max(int(ticks[-1]) + decimation, first_tick + (sent + dropped) * decimation))
    steps = np.diff(ticks)
    return [Gap(int(ticks[i]) + decimation, int(steps[i]) - decimation) for i in np.flatnonzero(steps > decimation)]
