"""Request and reply over one port: a session of our own, retries that do nothing twice, errors in words."""

from __future__ import annotations

import secrets
import struct
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import serial

from phaselead import interrupt
from phaselead.device import wire
from phaselead.device.framing import CRC_SIZE, FrameReader, encode_frame
from phaselead.device.quantities import TICK_HZ
from phaselead.device.status import target_of
from phaselead.errors import DeviceRefused, LinkError
from phaselead.serial_ports import Port

R = TypeVar("R", bound=wire.Reply)
Piece = Callable[[int, int, Sequence[float]], tuple[int, int]]

WAITS_S = (0.05,) * 12 + (0.1,) * 8 + (0.2,) * 8
"""How long each attempt at a command waits for its reply: 3 s in all. A reply comes within milliseconds, 16 ms of a USB
adapter included. Where 1 % of the bytes are lost, request and reply of 100 bytes together come through once in three
times, and none of 28 times once in 80,000."""
ROUNDING_S = 1e-6
"""Of a clock that is a float: a wait of one read is not two."""
HELLO_WAITS_S = WAITS_S[:20]
PIECE_WAITS_S = WAITS_S[:12]
"""Of a piece of a longer transfer, before it is made smaller."""
LARGEST_PIECE, SMALLEST_PIECE = 1024, 32
LEFT_ARMED_S = 1.5
"""A device that was left armed belongs to its last host for one second of silence: so long a hello is repeated."""
HELLO_AGAIN_S = 0.1
FLASH_WAITS_S = (6.0, 6.0)
"""An erase stalls the device for up to 2.6 s."""
OLDEST_HELLO = struct.Struct("<BQIH")
"""How the reply to a hello begins in every version from 2 on: status, tick, fingerprint, version."""
VERSION_1_HELLO = 75
"""Bytes of that reply in version 1, which did not tell its number."""
GREETING_1 = struct.Struct("<BQI20s24s")
"""How that reply begins in version 1: without number and revision."""
GREETING = struct.Struct("<BQIHH20s24s")
"""The same, and what follows in every version from 2 on: build id, target."""
SHORTEST_REPLY = wire.HEADER.size + wire.REPLY_HEAD.size + CRC_SIZE + 2
"""Bytes on the line: every reply has at least these, so asking for them at once never waits in vain."""

ADVICE = {
    wire.Status.NO_SESSION: "the device has restarted or another host has taken it; run the command again",
    wire.Status.UNKNOWN_COMMAND: "its firmware is older than this command; flash the firmware of this version",
    wire.Status.BAD_LENGTH: "its firmware is older than a part of this command; flash the firmware of this version",
    wire.Status.WRONG_STATE: "not in this state; `phaselead status` shows it, `phaselead park` ends it",
    wire.Status.BAD_VALUE: "a value it cannot use",
    wire.Status.NO_MODEL: "it holds no model; `phaselead upload` one first",
    wire.Status.MODEL_INVALID: "the model failed its checks",
    wire.Status.CRC_MISMATCH: "the data arrived damaged; try again",
    wire.Status.OUTSIDE_RECTANGLE: "outside the swing and frequency the model was identified for; "
    "use mode pid, a smaller path, or identify further",
    wire.Status.OUTSIDE_LIMITS: "outside the limits of the stage, or of the device (`phaselead limits`); "
    "use a smaller path or offset",
    wire.Status.BAUD_BUDGET: "the stream does not fit the line; use fewer axes or channels, or a decimation",
    wire.Status.MUST_NAME_MODEL: "its model is a fallback; arm naming the model, or upload and persist again",
    wire.Status.FLASH_FAILED: "its flash could not be written; the old model stays; try again",
    wire.Status.FAULT_LATCHED: "a fault is latched; `phaselead status` names it, `phaselead park` clears it",
    wire.Status.BUSY: "another host is driving it; stop that one, or wait until its session has timed out; what "
    "`phaselead move` left held, `phaselead park` ends",
    wire.Status.LIMITS_LOST: "its hard limits cannot be read any more; set them again with `phaselead limits`",
    wire.Status.LEARNED_FOR_OTHER: "what was learned is for another model, mode or path; give those, or learn again",
    wire.Status.MODE_UNSUPPORTED: "its firmware does not have this mode",
}
"""What a status means for every command; protocol/schema.toml says more where one command can."""


class Refused(DeviceRefused):
    """The device said no. ``status`` says why, ``reply`` is the whole reply where there was one."""

    def __init__(self, command: str, status: int, reply: wire.Reply | None = None, detail: str = "") -> None:
        self.command, self.status, self.reply = command, status, reply
        known = status in list(wire.Status)
        name = wire.Status(status).name.lower() if known else f"status {status}"
        general = ADVICE.get(wire.Status(status), "") if known else ""
        what = detail or general or "unknown to this version"
        super().__init__(f"{command} refused ({name}): {what}")


class SessionLostError(LinkError):
    """The device no longer knows our session."""


class Log(Protocol):
    """What ``Session.log`` may be: a list, or what else takes entries."""

    def append(self, entry: tuple[int, bytes], /) -> None: ...


class NoReplyError(LinkError):
    """No attempt at a command was answered: whether it was carried out is not known."""


@dataclass(frozen=True)
class Greeting:
    """What the reply to a hello says in every version of the wire."""

    fingerprint: int
    build_id: str
    target: str


@dataclass
class Pending:
    """A command on its way. ``body`` is the reply's once it has come; it took effect not before ``after_tick``."""

    command: wire.Command[Any]
    id: int
    frame: bytes
    after_tick: int = 0
    body: bytes | None = None


class Session:
    """Commands, replies and streams of one port. One thread speaks at a time, the one that holds ``lock``.

    ``samples`` collects the bodies of sample batches, ``events`` the events, for whoever wants them.
    ``log``, when set (to a list), collects (tick of the reply, frame sent) of every command answered.
    ``sink``, when set, is given every chunk as it came off the line; ``tap`` the sample batches of every read, which
    stay in ``samples``.
    """

    def __init__(self, port: Port, name: str = "port", *, nonce: int | None = None, last_id: int = 0) -> None:
        self.port, self.name = port, name
        self.nonce = nonce or secrets.randbits(64) or 1  # 0 is a device's "none yet"
        self.reader = FrameReader()
        self.samples: list[bytes] = []
        self.events: list[wire.Event] = []
        self.log: Log | None = None
        self.sink: Callable[[bytes], None] | None = None
        self.tap: Callable[[list[bytes]], None] | None = None
        self.lock = threading.RLock()
        self.retries = 0
        self.strays = 0
        """Frames that were nobody's: duplicates of replies, another session's."""
        self._nonce_bytes = self.nonce.to_bytes(8, "little")
        self._waiting: dict[int, Pending] = {}
        self.last_id = last_id
        """Of the requests sent; a session that is taken up goes on behind its last one."""
        self._piece = LARGEST_PIECE
        self._tick = 0
        """The last one that a reply has named."""
        self.tick_0_unix_s: float | None = None
        """Unix time of the device's tick 0, by our clock when it said hello; None before, and of a virtual port."""

    @property
    def virtual(self) -> bool:
        """Whether the port's time is not ours."""
        return hasattr(self.port, "clock_s")

    def now_s(self) -> float:
        """Seconds of the port's own time, which is the wall clock's where the port is no virtual one."""
        own_s: float | None = getattr(self.port, "clock_s", None)
        return time.monotonic() if own_s is None else own_s

    def greet(self) -> Greeting:
        """Opens the session with a device of any version of the wire.

        Raises:
            LinkError: nothing answers, or something that is no phaselead device.
            Refused: another host is driving the device.
        """
        payload = _payload(self._greeted())
        if payload and payload[0] != wire.Status.OK:
            raise Refused(wire.HelloRequest.NAME, payload[0])
        if len(payload) < GREETING.size:
            raise LinkError(f"the device on {self.name} says no hello that this version knows; use `phaselead flash`")
        numbers = GREETING_1 if len(payload) == VERSION_1_HELLO else GREETING
        _, _, fingerprint, *_, build_id, target = numbers.unpack_from(payload)
        return Greeting(fingerprint, build_id.hex(), target_of(target))

    def hello(self) -> wire.HelloReply:
        """Opens the session.

        Raises:
            LinkError: nothing answers, or something that is not a phaselead device of this version.
            Refused: another host is driving the device.
        """
        pending = self._greeted()
        payload = _payload(pending)
        if payload[:1] == bytes([wire.Status.OK]) and (why := self._why_another_wire(payload)):
            raise LinkError(why)
        reply: wire.HelloReply = self._reply(pending)
        self.tick_0_unix_s = None if self.virtual else time.time() - reply.tick / TICK_HZ
        return reply

    def _why_another_wire(self, payload: bytes) -> str:
        """What to update when the device of this hello speaks a wire that is no neighbour of ours; else nothing."""
        numbered = len(payload) >= OLDEST_HELLO.size and len(payload) != VERSION_1_HELLO
        _, _, fingerprint, version = OLDEST_HELLO.unpack_from(payload.ljust(OLDEST_HELLO.size, b"\0"))
        if fingerprint == wire.FINGERPRINT:
            return ""
        version = version if numbered else 1
        remedy = (
            "update phaselead"
            if version > wire.VERSION
            else "flash the firmware of this version (`phaselead flash`)"
            if version < wire.VERSION
            else "one of them is no release: flash the firmware of this version (`phaselead flash`)"
        )
        return (
            f"the device on {self.name} speaks another version of the wire ({version}, 0x{fingerprint:08X}; this "
            f"phaselead {wire.VERSION}, 0x{wire.FINGERPRINT:08X}); {remedy}"
        )

    def _greeted(self) -> Pending:
        self._write(b"\0")  # ends whatever half frame the line still holds
        began_s = self.now_s()
        pending = self._say_hello()
        while _payload(pending)[:1] == bytes([wire.Status.BUSY]) and self.now_s() - began_s < LEFT_ARMED_S:
            self.listen(HELLO_AGAIN_S)
            pending = self._say_hello()
        return pending

    def _say_hello(self) -> Pending:
        pending = self.submit(wire.HelloRequest())
        if not self._await(pending, HELLO_WAITS_S):
            raise LinkError(self._why_no_hello())
        return pending

    def listen(self, seconds: float) -> None:
        """Takes what comes, for so long of the port's own time."""
        until_s = self.now_s() + seconds
        while self.now_s() < until_s:
            self.pump(SHORTEST_REPLY)

    def request(self, command: wire.Command[R], waits_s: Sequence[float] = WAITS_S) -> R:
        """Sends a command and waits for its reply, sending the very same frame again when none comes.

        Raises:
            Refused: the reply's status is not ok.
            SessionLostError: the device no longer knows this session.
            LinkError: no reply after every attempt.
        """
        with self.lock:
            pending = self.submit(command)
            answered = self._await(pending, waits_s)
        if not answered:
            raise NoReplyError(
                f"the device on {self.name} stopped answering ({command.NAME}, {len(waits_s)} attempts); "
                "check cable and power, then try again"
            )
        reply: R = self._reply(pending)
        return reply

    def transfer(self, piece: Piece) -> None:
        """Moves bytes by calls of ``piece(offset, length, waits_s)``, which gives where the next piece begins and how
        many bytes there are in all.

        A piece that does not come through is tried again at half its length, down to 32 bytes: on a line that loses
        bytes a short frame arrives where no long one does. Later transfers begin with what came through.

        Raises:
            LinkError: not even the smallest piece comes through.
        """
        at, size = 0, 1
        while at < size:
            smallest = self._piece <= SMALLEST_PIECE
            try:
                at, size = piece(at, self._piece, WAITS_S if smallest else PIECE_WAITS_S)
            except NoReplyError:
                if smallest:
                    raise
                self._piece //= 2

    def reopen(self, port: Port) -> None:
        """Goes on over another port, with whatever is there."""
        self.port = port
        self.reader = FrameReader()
        self.samples, self.events = [], []
        self._waiting.clear()

    def renew(self) -> wire.HelloReply:
        """Another session in place of this one, which the device has forgotten. Raises as ``hello``."""
        self.nonce = secrets.randbits(64) or 1
        self._nonce_bytes = self.nonce.to_bytes(8, "little")
        self._tick = 0
        return self.hello()

    def submit(self, command: wire.Command[Any]) -> Pending:
        """Sends a command without waiting; ``pump`` fills in the reply, ``finish`` reads it."""
        with self.lock:
            self.last_id = self.last_id % 0xFFFF + 1
            body = wire.HEADER.pack(command.NUMBER, self.last_id, self.nonce) + command.pack()
            pending = Pending(command, self.last_id, encode_frame(body), self._tick)
            self._waiting[self.last_id] = pending
            self._write(pending.frame)
        return pending

    def resend(self, pending: Pending) -> None:
        """The very same frame again: the device recognises it and acts once."""
        self.retries += 1
        self._write(b"\0" + pending.frame)

    def finish(self, pending: Pending, reply_of: type[R]) -> R:
        """The reply of a submitted command whose ``body`` has come; raises as ``request`` does."""
        reply = self._reply(pending)
        assert isinstance(reply, reply_of)
        return reply

    def abandon(self, pending: Pending) -> None:
        self._waiting.pop(pending.id, None)

    def pump(self, size: int) -> int:
        """Reads up to ``size`` bytes, waiting for them at most the port's timeout, and sorts the frames. Meanwhile no
        other thread speaks: of two that read, one would find that the other has taken what was there."""
        interrupt.raise_if_asked()
        with self.lock:
            try:
                chunk = self.port.read(size)
            except (serial.SerialException, OSError) as error:
                raise LinkError(f"port {self.name} has gone away ({error}); reconnect it and try again") from None
            if chunk:
                if self.sink is not None:
                    self.sink(chunk)
                before = len(self.samples)
                for body in self.reader.feed(chunk):
                    self._sort(body)
                if self.tap is not None:
                    self.tap(self.samples[before:])
        return len(chunk)

    def _sort(self, body: bytes) -> None:
        if body[3:11] != self._nonce_bytes:
            self.strays += 1
        elif body[0] == wire.Samples.NUMBER:
            self.samples.append(body)
        elif body[0] == wire.Event.NUMBER:
            self.events.append(wire.Event.unpack(body[wire.HEADER.size :]))
        else:
            pending = self._waiting.get(int.from_bytes(body[1:3], "little"))
            if pending is None or body[0] != pending.command.NUMBER | wire.REPLY_BIT:
                self.strays += 1
                return
            pending.body = body
            del self._waiting[pending.id]
            payload = _payload(pending)
            if self.log is not None and len(payload) >= wire.REPLY_HEAD.size:
                self.log.append((wire.REPLY_HEAD.unpack_from(payload)[1], pending.frame))

    def _await(self, pending: Pending, waits_s: Sequence[float]) -> bool:
        for attempt, wait_s in enumerate(waits_s):
            if attempt:
                self.resend(pending)
            deadline_s = self.now_s() + wait_s - ROUNDING_S
            while pending.body is None and self.now_s() < deadline_s:
                self.pump(max(1, self.in_waiting()) if self.reader.inside_frame else SHORTEST_REPLY)
            if pending.body is None and (came := self.in_waiting()):
                self.pump(came)  # the time is over, but the host may have slept meanwhile
            if pending.body is not None:
                return True
        self.abandon(pending)
        return False

    def in_waiting(self) -> int:
        try:
            return self.port.in_waiting
        except (serial.SerialException, OSError) as error:
            raise LinkError(f"port {self.name} has gone away ({error}); reconnect it and try again") from None

    def _reply(self, pending: Pending) -> Any:
        payload, name = _payload(pending), pending.command.NAME
        if len(payload) < wire.REPLY_HEAD.size:
            raise wire.WireError(f"{name} reply: at least {wire.REPLY_HEAD.size} bytes expected, got {len(payload)}")
        status, tick = wire.REPLY_HEAD.unpack_from(payload)
        if tick < pending.after_tick and name != wire.StopRequest.NAME:
            # A late copy of our hello has made a fresh device take up the session again.
            raise SessionLostError(f"{name} on {self.name}: the device has restarted; run the command again")
        self._tick = max(self._tick, tick)
        if status == wire.Status.OK:
            return pending.command.REPLY.unpack(payload)
        if status == wire.Status.NO_SESSION:
            raise SessionLostError(f"{name} on {self.name}: {ADVICE[wire.Status.NO_SESSION]}")
        whole = len(payload) > wire.REPLY_HEAD.size
        reply = pending.command.REPLY.unpack(payload) if whole else None
        raise Refused(name, status, reply, pending.command.REFUSALS.get(status, ""))

    def _write(self, data: bytes) -> None:
        try:
            with self.lock:
                self.port.write(data)
        except (serial.SerialException, OSError) as error:
            raise LinkError(f"port {self.name} cannot be written ({error}); reconnect it and try again") from None

    def _why_no_hello(self) -> str:
        received, frames = self.reader.received, self.reader.frames
        if received == 0:
            return f"nothing answers on {self.name}; check cable and power, `phaselead ports` lists the ports"
        if frames == 0:
            return (
                f"{self.name} speaks, but not phaselead ({received} bytes and no frame among them); "
                "wrong port, wrong baud rate or other firmware: `phaselead ports` lists the ports"
            )
        return (
            f"{self.name} sends frames but no reply to hello ({frames} whole, {self.reader.errors} damaged); "
            "power-cycle the device and try again"
        )


def _payload(pending: Pending) -> bytes:
    assert pending.body is not None
    return pending.body[wire.HEADER.size :]
