"""A device in a few lines of Python behind a pyserial-like port, with faults that a test can order.

It runs in virtual time: a tick is 1/5000 s, 40 bytes leave per tick, reading advances it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any
from zlib import crc32

from phaselead.device import wire
from phaselead.device.framing import FrameReader, encode_frame

BYTES_PER_TICK = 40
BATCH_TICKS = 50
RAMP_TICKS = 300
MODEL = bytes(range(200))
STATE = bytes(range(256)) * 9
Faults = Callable[[bytes], list[bytes]]


def deliver(frame: bytes) -> list[bytes]:
    return [frame]


@dataclass
class FakeDevice:
    """What the device believes; ``on_frame`` decides what of its frames reaches the line, and how often."""

    on_frame: Faults = deliver
    on_command: Faults = deliver
    fingerprint: int = wire.FINGERPRINT
    version: int = wire.VERSION
    status_of: dict[type[Any], wire.Status] = field(default_factory=dict)
    fault_tick: int | None = None
    tick: int = 0
    session: int = 0
    state: wire.State = wire.State.PARKED
    parked_at: int | None = None
    stream: wire.StreamStartRequest | None = None
    stream_tick: int = 0
    sequence: int = 0
    taken: int = 0
    executed: list[str] = field(default_factory=list)
    replies: dict[tuple[int, int], bytes] = field(default_factory=dict)
    out: bytes = b""
    batch: list[int] = field(default_factory=list)
    reader: FrameReader = field(default_factory=FrameReader)
    heard: int = 0

    def receive(self, data: bytes) -> None:
        for frame in self.on_command(data):
            for body in self.reader.feed(frame):
                self._obey(body)

    def restart(self) -> None:
        """As after a power cut: nothing of the session is left."""
        self.session, self.state, self.stream, self.tick = 0, wire.State.PARKED, None, 0
        self.replies.clear()

    def send(self, number: int, request: int, payload: bytes, session: int | None = None) -> None:
        header = wire.HEADER.pack(number, request, self.session if session is None else session)
        for frame in self.on_frame(encode_frame(header + payload)):
            self.out += frame

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            if self.parked_at is not None and self.tick >= self.parked_at:
                self.state, self.parked_at = wire.State.PARKED, None
            if self.fault_tick == self.tick:
                self.state, self.stream = wire.State.FAULT, None
                self._flush()
                self.send(wire.Event.NUMBER, 0, wire.Event(self.tick, wire.EventKind.FAULT, 3).pack())
            if self.stream is not None and (self.tick - self.stream_tick) % self.stream.decimation == 0:
                self.batch.append(self.tick)
                self.taken += 1
                if len(self.batch) == BATCH_TICKS:
                    self._flush()
            self.tick += 1

    def _flush(self) -> None:
        stream = self.stream or wire.StreamStartRequest(wire.Channel.ADC, 1, 1)
        if self.batch:
            data = b"".join((t % 65536).to_bytes(2, "little") for t in self.batch)
            head = wire.Samples(self.sequence, self.batch[0], 0, stream.channels, stream.axis_mask, 1, data)
            self.send(wire.Samples.NUMBER, 0, replace(head, decimation=stream.decimation).pack())
            self.sequence, self.batch = self.sequence + 1, []

    def _obey(self, body: bytes) -> None:
        number, request, session = wire.HEADER.unpack_from(body)
        command = wire.MESSAGES[number].unpack(body[wire.HEADER.size :])
        assert isinstance(command, wire.Command)
        if isinstance(command, wire.HelloRequest):
            self.session = session
        key = (session, request)
        if key not in self.replies:
            self.executed.append(command.NAME)
            self.replies[key] = self._answer(command, session)
        self.send(number | wire.REPLY_BIT, request, self.replies[key], session)

    def _answer(self, command: wire.Command[Any], session: int) -> bytes:
        status = self.status_of.get(type(command), wire.Status.OK)
        if session != self.session and not isinstance(command, wire.StopRequest):
            status = wire.Status.NO_SESSION
        if status != wire.Status.OK:
            return wire.REPLY_HEAD.pack(status, self.tick)
        self.heard = self.tick
        reply: wire.Reply = self._do(command)
        return reply.pack()

    def _do(self, command: wire.Command[Any]) -> wire.Reply:
        head = (wire.Status.OK, self.tick)
        match command:
            case wire.HelloRequest():
                state = (3, self.state, 0, 0, 0, wire.MAX_PAYLOAD)
                return wire.HelloReply(
                    *head,
                    self.fingerprint,
                    self.version,
                    wire.REVISION,
                    bytes(20),
                    b"fake".ljust(24, b"\0"),
                    5000,
                    2000000,
                    *state,
                )
            case wire.StatusRequest():
                fault = (3, 0) if self.state == wire.State.FAULT else (0, 255)
                rest = 7 if self.state == wire.State.PARKED else 0
                codes = ((0, 0, 0), rest, (1, 2, 3), (4, 5, 6), (0, 0, 0), 0, 0, 0, 0)
                return wire.StatusReply(*head, self.state, *fault, 0, self.fault_tick or 0, *codes)
            case wire.ArmRequest():
                self.state = wire.State.ARMED
            case wire.StartRequest():
                self.state = wire.State.RUNNING
                return wire.StartReply(*head, self.tick + 1)
            case wire.ParkRequest() | wire.StopRequest() if self.state in (
                wire.State.ARMED,
                wire.State.RUNNING,
            ):
                self.state, self.parked_at = wire.State.STOPPING, self.tick + RAMP_TICKS
            case wire.StreamStartRequest():
                self.stream, self.sequence, self.taken, self.batch = command, 0, 0, []
                self.stream_tick = self.tick
                return wire.StreamStartReply(*head, 20000, 190000, len(STATE))
            case wire.StreamStopRequest():
                self._flush()
                self.stream = None
                return wire.StreamStopReply(*head, self.taken, 0)
            case wire.SnapshotReadRequest():
                data = STATE[command.offset : command.offset + command.length]
                return wire.SnapshotReadReply(*head, len(STATE), data)
            case wire.ModelReadRequest():
                data = MODEL[command.offset : command.offset + command.length]
                return wire.ModelReadReply(*head, len(MODEL), crc32(MODEL), data)
            case wire.SetPathRequest():
                return wire.SetPathReply(*head, 0, 0)
            case wire.ModelPersistRequest():
                return wire.ModelPersistReply(*head, 1)
        reply: wire.Reply = command.REPLY(*head)
        return reply


@dataclass
class FakePort:
    device: FakeDevice
    timeout: float | None = 0.05
    closed: bool = False

    @property
    def clock_s(self) -> float:
        return self.device.tick / 5000

    @property
    def in_waiting(self) -> int:
        return len(self.device.out)

    def read(self, size: int = 1) -> bytes:
        left = round((self.timeout or 0.0) * 5000)
        while len(self.device.out) < size and left > 0:
            self.device.run(1)
            left -= 1
        chunk, self.device.out = self.device.out[:size], self.device.out[size:]
        return chunk

    def write(self, data: bytes) -> int:
        self.device.receive(data)
        return len(data)

    def close(self) -> None:
        self.closed = True


@dataclass
class NoisePort(FakePort):
    """Speaks the same text whatever one says."""

    text: bytes = b"login: \r\n"

    def read(self, size: int = 1) -> bytes:
        self.device.tick += 10 if self.text else round((self.timeout or 0.0) * 5000)
        return (self.text * size)[:size]

    def write(self, data: bytes) -> int:
        return len(data)
