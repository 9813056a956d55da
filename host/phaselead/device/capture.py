"""The capture loop: streams, keeps the host timeout fed, and gathers all that a replay needs."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from phaselead.device import wire
from phaselead.device.parking import fault_text, park_quietly, wait_parked
from phaselead.device.points import PointFeeder
from phaselead.device.quantities import STOP_S, TICK_HZ
from phaselead.device.regions import read_model, read_region, read_wave
from phaselead.device.session import Pending, Refused, Session
from phaselead.device.stream import (
    ALL_CHANNELS,
    HEAD,
    Capture,
    Stream,
    decode_samples,
    mask_of,
    tick_dtype,
)
from phaselead.errors import DeviceRefused, LinkError

FEED_S = 0.2
"""STATUS this often, or one read later: a quarter of the host timeout the command line drives with."""
REPLY_S = 0.1
ATTEMPTS = 30
"""At the status; together as long as a command's."""
SILENCE_S = 3.0
READ_REAL_S, READ_VIRTUAL_S, READ_FEEDING_S = 0.05, 0.1, 0.02
LONGEST_READ_S = 1.0
"""Counted of one read that brings nothing: a host that slept has not listened meanwhile."""
FIRST_TICK = slice(HEAD.fields["first_tick"][1], HEAD.fields["first_tick"][1] + 8)  # type: ignore[index]

Progress = Callable[[int], None]
Sink = Callable[[bytes], None]


class Spool(Protocol):
    """Takes a capture that may be larger than the memory, as it comes."""

    def received(self, chunk: bytes) -> None:
        """A chunk as it came off the line."""

    def answered(self, tick: int, frame: bytes) -> None:
        """A command that took effect before this tick."""


class DeviceFault(DeviceRefused):
    """The device latched a fault during a capture; ``capture`` holds what was recorded.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     try:
    ...         dev.track("sine:20um@5Hz", mode="pid", gains=(0.017, 8.62, 0))  # unstable without its derivative
    ...     except pl.DeviceFault as fault:
    ...         print(fault, len(fault.capture.ticks) > 0)
    fault oscillation on axis x at tick ...; the loop of x is unstable: ... True
    """

    def __init__(self, message: str, capture: Capture) -> None:
        super().__init__(message)
        self.capture = capture


class RanDry(DeviceFault):
    """The points of a path came too late: the axes stopped within their limits, held, and were parked."""


@dataclass(frozen=True)
class QueuedPaths:
    """Paths that do not begin with a start: they are queued behind what their axes do."""

    queue: wire.QueueRequest
    joined_ticks: int
    """From when they are due to when they have been entered: their look ahead and the longest join."""
    after_ticks: int | None = None
    """The axes are started first, to hold where they stand, and the queue is sent so much later; None: they are held
    already, or follow paths."""
    within_s: float | None = None
    """They wait for an edge of the trigger input, which may take so long; None: for none."""

    def first_tick(self, queued_tick: int) -> int:
        """In which paths begin that were queued in this tick and wait for nothing."""
        return queued_tick + 1 + self.joined_ticks


class NoEdge(DeviceRefused):
    """No edge came at the trigger input; the device was parked, or holds where it was."""


def no_edge(within_s: float) -> str:
    """Says so, and what can be done."""
    return (
        f"no edge came at the trigger input within {within_s:g} s; look at its wire (docs/board.md; of a virtual stage "
        "sim://...?trigger=2s), or wait longer"
    )


@dataclass(frozen=True)
class Plan:
    """What to capture. ``axes`` are letters; ``start`` arms and starts their paths together."""

    ticks: int
    axes: str = "x"
    channels: int = ALL_CHANNELS
    decimation: int = 1
    start: bool = True
    park: bool = True
    model_crc: int = 0
    wave_axes: str = ""
    """Axes whose waveform has to be read back for a replay, where they have one."""
    spool: Spool | None = None
    """Takes samples and commands, which the capture then does not hold."""
    start_axes: str = ""
    """Axes whose paths are started; empty: all that are streamed."""
    lead_ticks: int = 0
    """Of the record that lie before the paths begin, on the way into them."""
    tail_ticks: int = 0
    """Run on after the record, before parking: the paths are being left."""
    feeder: PointFeeder | None = None
    """Sends what the paths still lack."""
    queued: QueuedPaths | None = None
    """The paths, where they are not those that a start begins."""

    @property
    def axis_mask(self) -> int:
        return mask_of(self.axes)

    @property
    def is_held_before(self) -> bool:
        """The axes are held, or follow paths, when it begins."""
        return self.queued is not None and self.queued.after_ticks is None


@dataclass
class _Run:
    """One capture under way. Its clock counts ticks of the stream, and silence where no ticks come."""

    session: Session
    plan: Plan
    first_tick: int = 0
    """Of the stream, once it is open."""
    clock_s: float = 0.0
    next_tick: int = 0
    bodies: list[bytes] = field(default_factory=list)
    """Batches, unless a spool takes them."""
    sample_bytes: int = 0
    """Of all batches that have come."""
    status: wire.StatusReply | None = None
    pending: Pending | None = None
    asked_s: float = 0.0
    attempts: int = 0
    silent_s: float = 0.0
    events_seen: int = 0
    damaged_before: int = 0
    """Frames that had come damaged when the capture began."""
    tick_size: int = field(init=False)
    keeps_held: bool = field(init=False)
    """The axes were held before and none has left its place for this capture: no path has been queued yet, or what was
    queued has been dropped."""

    def __post_init__(self) -> None:
        self.tick_size = tick_dtype(self.plan.channels, self.plan.axis_mask).itemsize
        self.keeps_held = self.plan.is_held_before

    def open_stream(self) -> wire.StreamStartReply:
        """Raises Refused where the line is too slow for it."""
        first = _stream_start(self.session, self.plan)
        self.first_tick = self.next_tick = first.tick
        self.damaged_before = self.session.reader.errors
        return first

    def bytes_of(self, seconds: float) -> int:
        """Of the stream, in so much device time."""
        return max(64, int(self.tick_size * TICK_HZ * seconds / self.plan.decimation))

    def pump(self, size: int) -> None:
        session, before = self.session, self.next_tick
        began_s = session.now_s()
        session.pump(size)
        came = self.collect()
        if came:
            last = came[-1]
            ticks = (len(last) - HEAD.itemsize) // self.tick_size * self.plan.decimation
            self.next_tick = int.from_bytes(last[FIRST_TICK], "little") + ticks
        if self.next_tick > before:
            self.clock_s += (self.next_tick - before) / TICK_HZ
            self.silent_s = 0.0
        else:
            waited_s = min(session.now_s() - began_s, LONGEST_READ_S)
            self.clock_s += waited_s
            self.silent_s += waited_s

    def collect(self) -> list[bytes]:
        """Takes over the batches that the session has gathered; not those of a stream before this one, whose last may
        still have been under way when it was stopped."""
        gathered, self.session.samples = self.session.samples, []
        came = [body for body in gathered if int.from_bytes(body[FIRST_TICK], "little") >= self.first_tick]
        self.sample_bytes += sum(map(len, came)) - HEAD.itemsize * len(came)
        if self.plan.spool is None:
            self.bodies += came
        return came

    def feed(self) -> None:
        """Asks for the status when it is due or something has happened, without waiting for the answer."""
        session, pending = self.session, self.pending
        if pending is not None and pending.body is not None:
            self.status, self.pending = session.finish(pending, wire.StatusReply), None
        news = len(session.events) > self.events_seen
        if self.pending is None:
            if news or self.clock_s - self.asked_s >= FEED_S:
                self.events_seen = len(session.events)
                self.pending = session.submit(wire.StatusRequest())
                self.asked_s, self.attempts = self.clock_s, 1
        elif self.clock_s - self.asked_s >= REPLY_S:
            if self.attempts >= ATTEMPTS:
                raise LinkError(f"the device on {session.name} stopped answering; check cable and power")
            session.resend(self.pending)
            self.asked_s, self.attempts = self.clock_s, self.attempts + 1

    @property
    def faulted(self) -> bool:
        return self.status is not None and self.status.state == wire.State.FAULT

    def run_to(self, end_tick: int, progress: Progress | None, from_tick: int) -> None:
        """Until the stream has passed ``end_tick``, or a fault."""
        feeder, read_s = self.plan.feeder, READ_VIRTUAL_S if self.session.virtual else READ_REAL_S
        chunk = self.bytes_of(read_s if feeder is None else READ_FEEDING_S)
        while self.next_tick < end_tick and not self.faulted and not (feeder is not None and feeder.over):
            left = self.bytes_of(max(end_tick - self.next_tick, 1) / TICK_HZ) + HEAD.itemsize
            self.pump(min(chunk, left))
            self.feed()
            if feeder is not None:
                feeder.feed()
            if self.silent_s > SILENCE_S:
                raise LinkError(self.why_silent())
            if progress is not None:
                progress(min(max(self.next_tick - from_tick, 0), end_tick - from_tick))

    def begin(self) -> int:
        """Begins the paths: the tick in which they do, or the last one when a fault came first. Raises NoEdge."""
        plan, queued = self.plan, self.plan.queued
        if queued is None or queued.after_ticks is not None:
            self.session.request(wire.ArmRequest(plan.model_crc))
            started_tick = self.session.request(wire.StartRequest(mask_of(plan.start_axes or plan.axes))).first_tick
            if queued is None:
                return started_tick
            assert queued.after_ticks is not None
            self.run_on(started_tick + queued.after_ticks)
        if self.faulted:
            return self.next_tick
        queued_tick = self.session.request(queued.queue).tick
        self.keeps_held = False
        return queued.first_tick(queued_tick) if queued.within_s is None else self._wait_for_edge(queued.within_s)

    def _wait_for_edge(self, within_s: float) -> int:
        self.status, self.pending = None, None  # of before the paths were queued
        end_s = self.clock_s + within_s
        while not self.faulted:
            if self.status is not None and self.status.first_tick:
                return self.status.first_tick
            if self.clock_s > end_s:
                if self.plan.is_held_before:
                    self._drop_queued()
                raise NoEdge(no_edge(within_s))
            self.pump(self.bytes_of(READ_FEEDING_S))
            self.feed()
            if self.silent_s > SILENCE_S:
                raise LinkError(self.why_silent())
        return self.next_tick

    def _drop_queued(self) -> None:
        """Holds the axes in place of what waits for them, which a later edge would begin."""
        assert self.plan.queued is not None
        queue = self.plan.queued.queue
        join = max(round(STOP_S * TICK_HZ), *(one.enter_ticks for one in queue.segments))
        hold = wire.Segment(wire.PathKind.HOLD, wire.PathFlag.FROM_HERE, 0, 0, 0, 0, join, 0)
        self.session.request(wire.QueueRequest(queue.axis_mask, 1, 0, (hold,) * len(queue.segments)))
        self.keeps_held = True

    def run_on(self, end_tick: int) -> None:
        """Until the stream has passed ``end_tick``, or a fault; nothing is sent."""
        while self.next_tick < end_tick and not self.faulted:
            self.pump(self.bytes_of(READ_FEEDING_S))
            self.feed()
            if self.silent_s > SILENCE_S:
                raise LinkError(self.why_silent())

    def why_silent(self) -> str:
        reader = self.session.reader
        if reader.errors > self.damaged_before:
            return (
                f"no samples come whole from {self.session.name}: {reader.errors - self.damaged_before} frames arrived "
                "damaged; use a shorter or better cable, or fewer channels"
            )
        return f"the stream from {self.session.name} stopped; check cable and power, then try again"

    def drain(self, sent: int) -> None:
        """Until everything sent before the stream was stopped has come, or nothing comes any more."""
        while self.silent_s < 2 * (self.session.port.timeout or 0.0):
            self.collect()
            if self.sample_bytes >= sent * self.tick_size:
                return
            self.pump(max(64, self.session.in_waiting()))


@dataclass(frozen=True)
class _Answered:
    """A session's log that keeps nothing."""

    spool: Spool

    def append(self, entry: tuple[int, bytes], /) -> None:
        self.spool.answered(*entry)


def capture(
    session: Session,
    hello: wire.HelloReply,
    plan: Plan,
    progress: Progress | None = None,
    sink: Sink | None = None,
) -> Capture:
    """Streams, starts, runs ``plan.ticks`` ticks, parks, stops the stream and takes what is still under way.

    ``progress`` is given the ticks done after every chunk; ``sink`` every chunk as it came off the line. On
    Ctrl-C and on every error the device is parked before the exception goes on; axes that were held before stay so
    where their paths are refused, or hold where no edge came, after which none begins the paths any more.

    Raises:
        DeviceFault: the device latched a fault; the exception carries what was recorded until then.
        DeviceRefused, LinkError: as for every command.
    """
    timeout_s = session.port.timeout
    session.samples, session.events, session.log = [], [], []
    session.sink = sink if plan.spool is None else plan.spool.received
    run = _Run(session, plan)
    try:
        if session.virtual:
            session.port.timeout = READ_VIRTUAL_S
        with session.lock:
            return _capture(run, hello, progress)
    except DeviceFault:
        raise
    except BaseException as error:
        if run.keeps_held and _is_held_after(error):
            with contextlib.suppress(Refused):  # the stream itself was
                session.request(wire.StreamStopRequest())
            raise
        if not isinstance(error, (LinkError, DeviceRefused, KeyboardInterrupt)):
            session.sink = None  # it may be what has failed, and would fail again
        park_quietly(session)
        raise
    finally:
        with contextlib.suppress(OSError):  # a port that has gone away takes no settings
            session.port.timeout = timeout_s
        session.samples, session.log, session.sink = [], None, None


def _is_held_after(error: BaseException) -> bool:
    """Whether axes that were held are held still."""
    if isinstance(error, Refused):
        return error.status not in (wire.Status.FAULT_LATCHED, wire.Status.WRONG_STATE)
    return isinstance(error, NoEdge)


def _capture(run: _Run, hello: wire.HelloReply, progress: Progress | None) -> Capture:
    session, plan = run.session, run.plan
    first = run.open_stream()
    session.log = [] if plan.spool is None else _Answered(plan.spool)
    state = read_region(session, wire.Region.STATE, first.state_size)
    found = {axis: read_wave(session, axis) for axis in plan.wave_axes}
    waves = {axis: points for axis, points in found.items() if points is not None}
    model = read_model(session)
    start_tick = -1
    if plan.start:
        start_tick = run.begin() - plan.lead_ticks
    begin = start_tick if plan.start else first.tick
    end_tick = begin + plan.ticks
    run.run_to(end_tick, progress, begin)
    dry_tick = None if plan.feeder is None else plan.feeder.dry_tick
    end_tick = end_tick if dry_tick is None else dry_tick
    run.run_on(end_tick + plan.tail_ticks)
    status = session.request(wire.StatusRequest())
    if plan.park:  # in a fault too: what was held goes home
        session.request(wire.ParkRequest())
        status = wait_parked(session, run.bytes_of(0.01))
    stopped = session.request(wire.StreamStopRequest())
    run.silent_s = 0.0
    run.drain(stopped.sent_ticks)
    run.collect()
    rows = stopped.sent_ticks, stopped.dropped_ticks
    if plan.spool is None:
        stream = decode_samples(run.bodies, first.tick, *rows, plan.decimation)
    else:
        stream = Stream(
            np.empty(0, np.int64), {}, plan.channels, plan.axis_mask, plan.decimation, dropped_ticks=rows[1]
        )
    taken = Capture(
        hello=hello,
        session=session.nonce,
        stream=stream,
        first_tick=first.tick,
        start_tick=start_tick,
        end_tick=end_tick,
        state=state,
        model=model,
        waves=waves,
        command_log=session.log if isinstance(session.log, list) else [],
        events=session.events,
        status=status,
        tick_0_unix_s=session.tick_0_unix_s,
        rows_end=first.tick + sum(rows) * plan.decimation,
    )
    if status.state == wire.State.FAULT:
        raise DeviceFault(fault_text(status), taken)
    if dry_tick is not None:
        raise RanDry(
            f"the path ran dry {(dry_tick - begin) / TICK_HZ:.3f} s after its begin: its points came too late; the "
            "axes stopped, held and were parked. Free computer and line of other work, and play it again",
            taken,
        )
    return taken


def _stream_start(session: Session, plan: Plan) -> wire.StreamStartReply:
    request = wire.StreamStartRequest(plan.channels, plan.axis_mask, plan.decimation)
    try:
        return session.request(request)
    except Refused as refusal:
        reply = refusal.reply
        if refusal.status != wire.Status.BAUD_BUDGET or not isinstance(reply, wire.StreamStartReply):
            raise
        size = tick_dtype(plan.channels, plan.axis_mask).itemsize
        detail = (
            f"{size} bytes a tick make {reply.bytes_per_s} bytes/s with their frames, the line carries "
            f"{reply.budget_bytes_per_s}; use fewer axes or channels, or a decimation"
        )
        raise Refused(refusal.command, refusal.status, reply, detail) from None
