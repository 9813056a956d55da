"""A line that goes wrong: it stands between a host and any port, and what it does hangs on its seed alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from random import Random

import serial

from phaselead.device import wire
from phaselead.errors import BadInput
from phaselead.serial_ports import BAUD, Port

BITS = 8
LINE_BITS = 10
LONGEST_FRAME = 4096
"""More bytes than this without a delimiter are no frame and pass as they are."""


@dataclass(frozen=True)
class LineFaults:
    """What goes wrong on the line, each way, as probabilities.

    Of a byte: ``lose``. Of a bit: ``flip``. Of a frame (up to and with its zero byte): ``duplicate`` (a copy comes up
    to ``late_frames`` frames later), ``reorder`` (comes after the next one), ``delay`` (comes up to ``late_frames``
    frames later), ``truncate`` (ends early). Of a frame of the host: ``unplug`` (the port goes away, for ``away_s`` of
    the device's time), ``reset`` (the device restarts).
    """

    lose: float = 0.0
    flip: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay: float = 0.0
    truncate: float = 0.0
    unplug: float = 0.0
    reset: float = 0.0
    late_frames: int = 20
    away_s: float = 2.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("lose", "flip", "duplicate", "reorder", "delay", "truncate", "unplug", "reset"):
            if not 0 <= getattr(self, name) <= 1:
                raise BadInput(f"{name}={getattr(self, name):g}: a probability, from 0 to 1")
        if self.late_frames < 1 or not 0 <= self.away_s < math.inf:
            raise BadInput("late_frames must be at least 1, away_s at least 0")


class Way:
    """One direction: whole frames in, bytes out."""

    def __init__(self, faults: LineFaults, name: str) -> None:
        self._faults = faults
        self._random = Random(f"{faults.seed}/{name}")
        self._part = b""
        self._late: list[tuple[int, bytes]] = []
        """Frames on the way, and how many others pass before each."""
        self._to_loss = self._gap(faults.lose)
        self._to_flip = self._gap(faults.flip)

    def _gap(self, probability: float) -> float:
        """How many go by unharmed until it happens next: geometric."""
        if probability <= 0:
            return math.inf
        return 0 if probability >= 1 else int(math.log(1 - self._random.random()) / math.log1p(-probability))

    def _happens(self, probability: float) -> bool:
        return probability > 0 and self._random.random() < probability

    def carry(self, data: bytes) -> bytes:
        """What comes out at the other end when this is put in."""
        *frames, self._part = (self._part + data).split(b"\0")
        out = b"".join(piece for frame in frames for piece in self._frame(frame + b"\0"))
        if len(self._part) > LONGEST_FRAME:
            out, self._part = out + self._part, b""
        return self._bytes(out)

    def clear(self) -> None:
        """What is on the way is lost."""
        self._part, self._late = b"", []

    def _frame(self, frame: bytes) -> Iterator[bytes]:
        faults, random = self._faults, self._random
        self._late = [(left - 1, late) for left, late in self._late]
        if self._happens(faults.truncate):
            frame = frame[: random.randrange(len(frame))]
        if self._happens(faults.duplicate):
            self._late.append((random.randint(0, faults.late_frames), frame))
        if self._happens(faults.reorder):
            self._late.append((1, frame))
        elif self._happens(faults.delay):
            self._late.append((random.randint(1, faults.late_frames), frame))
        else:
            yield frame
        yield from (late for left, late in self._late if left <= 0)
        self._late = [(left, late) for left, late in self._late if left > 0]

    def _bytes(self, data: bytes) -> bytes:
        bent = bytearray(data)
        while self._to_flip < BITS * len(bent):
            at = int(self._to_flip)
            bent[at // BITS] ^= 1 << at % BITS
            self._to_flip += 1 + self._gap(self._faults.flip)
        self._to_flip -= BITS * len(bent)
        lost = []
        while self._to_loss < len(bent):
            lost.append(int(self._to_loss))
            self._to_loss += 1 + self._gap(self._faults.lose)
        self._to_loss -= len(bent)
        for at in reversed(lost):
            del bent[at]
        return bytes(bent)


class FaultyLine:
    """A port behind a line that goes wrong as ``faults`` say, or when ``unplug`` or ``reset`` is called.

    Wraps whatever ``port`` is; its time is that port's.

    >>> import phaselead as pl
    >>> with pl.connect("faulty://sim://xyz250#lose=0.01&flip=1e-4&seed=7") as dev:
    ...     print(dev.status().state)
    parked
    """

    def __init__(self, port: Port, faults: LineFaults) -> None:
        self.port, self.faults = port, faults
        self.plugged = True
        self.unplugged = self.restarted = 0
        """How often."""
        self._random = Random(f"{faults.seed}/events")
        self._up, self._down = Way(faults, "up"), Way(faults, "down")
        self._came = b""

    def write(self, data: bytes) -> int:
        """Raises serial.SerialException when the port has gone away."""
        self._require_plugged()
        for _ in range(data.count(b"\0")):
            if self._random.random() < self.faults.unplug:
                self.unplug()
            elif self._random.random() < self.faults.reset:
                self.reset()
        self._require_plugged()
        if carried := self._up.carry(data):
            self.port.write(carried)
        return len(data)

    def read(self, size: int = 1) -> bytes:
        """Up to ``size`` bytes, within the port's timeout. Raises serial.SerialException when it has gone away."""
        self._require_plugged()
        most = size + int((self.port.timeout or 0.0) * BAUD / LINE_BITS)
        while len(self._came) < size and most > 0:
            asked = size - len(self._came)
            got = self.port.read(asked)
            self._came += self._down.carry(got)
            most -= len(got)
            if len(got) < asked:  # the timeout is over
                break
        out, self._came = self._came[:size], self._came[size:]
        return out

    @property
    def in_waiting(self) -> int:
        """Bytes that have come, or at least may come at once."""
        self._require_plugged()
        return len(self._came) or self.port.in_waiting

    @property
    def timeout(self) -> float | None:
        """Of a read, in seconds; the port's own."""
        return self.port.timeout

    @timeout.setter
    def timeout(self, seconds: float | None) -> None:
        self.port.timeout = seconds

    @property
    def clock_s(self) -> float:
        """The port's own time, if it has one."""
        return float(self.port.clock_s)  # type: ignore[attr-defined]

    def close(self) -> None:
        """Closes the port."""
        self.port.close()

    def _require_plugged(self) -> None:
        if not self.plugged:
            raise serial.SerialException("device disconnected")

    # ---------------------------------------------------------------- what a test makes happen

    def unplug(self) -> None:
        """The cable is pulled: what is on the way is lost, the device runs on."""
        self.plugged = False
        self.unplugged += 1

    def plug_in(self) -> None:
        """Puts the cable in again, ``away_s`` later; what the device has said meanwhile is lost."""
        if not self.plugged:
            self.let_pass(self.faults.away_s)
            self.plugged = True

    def let_pass(self, seconds: float) -> None:
        """As if the host slept so long: the device runs on, and what it says is lost. Virtual ports alone."""
        advance = getattr(self.port, "advance", None)
        if advance is not None:
            advance(seconds)
        self._up.clear()
        self._down.clear()
        self._came = b""
        forget = getattr(self.port, "reset_input_buffer", None)
        if forget is not None:
            forget()

    def reset(self) -> None:
        """The device restarts; simulated ones alone. Raises BadInput for another."""
        inject = getattr(getattr(self.port, "device", None), "inject", None)
        if inject is None:
            raise BadInput("reset: only a device in this process (sim://) can be restarted by its line")
        inject(wire.Fault.CORE_LOST)
        self.restarted += 1
