"""The faults that a device remembers over resets."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from typing import Any

from phaselead.device import wire
from phaselead.device.device import Device
from phaselead.device.quantities import TICK_HZ
from phaselead.device.regions import read_region
from phaselead.device.status import NO_AXIS, fault_detail, name_of
from phaselead.device.stream import axes_of
from phaselead.result import Result, Table

IN_PIECES_SINCE = 3
"""Revision of the wire."""
HEAD = struct.Struct("<I")
"""The power cycle; the faults follow, newest first."""
HEADINGS = ("power cycle", "tick", "after (s)", "fault", "axis", "in state", "detail")


@dataclass(frozen=True)
class LoggedFault:
    """One fault: when it was latched (start of the device, tick since then), what, on which axis, in which state."""

    power_cycle: int
    tick: int
    after_s: float
    fault: str
    axis: str
    state: str
    detail: int | str


@dataclass(frozen=True)
class FaultLog(Result):
    """The last 16 faults of a device, oldest first; prints as a table. ``power_cycle`` is the number of its present
    start, resets included."""

    power_cycle: int
    faults: tuple[LoggedFault, ...]

    def __iter__(self) -> Iterator[LoggedFault]:
        return iter(self.faults)

    def __len__(self) -> int:
        return len(self.faults)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"power_cycle": self.power_cycle, "faults": [asdict(fault) for fault in self.faults]}

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One row a fault."""
        return {field.name: [getattr(fault, field.name) for fault in self.faults] for field in fields(LoggedFault)}

    def tables(self) -> list[Table | str]:
        now = f"power cycle {self.power_cycle}"
        if not self.faults:
            return [f"{now}; no fault so far"]
        rows = tuple(tuple(str(value) for value in asdict(fault).values()) for fault in self.faults)
        return [Table(HEADINGS, rows), now]


def read_fault_log(device: Device) -> FaultLog:
    """The faults that the device remembers, those before its last resets included; in pieces if the line needs it."""
    session = device.session
    if device.hello.wire_revision < IN_PIECES_SINCE:
        reply = session.request(wire.FaultLogRequest())
        return FaultLog(reply.power_cycle, tuple(_in_words(fault) for fault in reply.faults[: reply.count]))
    log, newest = b"", b"?"
    while not log.startswith(newest):  # another fault came between two pieces
        log = read_region(session, wire.Region.FAULTS)
        newest = session.request(
            wire.SnapshotReadRequest(wire.Region.FAULTS, 0, HEAD.size + wire.LoggedFault.SIZE)
        ).data
    (power_cycle,) = HEAD.unpack_from(log)
    starts = range(HEAD.size, len(log), wire.LoggedFault.SIZE)
    faults = [wire.LoggedFault.unpack(log[at : at + wire.LoggedFault.SIZE]) for at in starts]
    return FaultLog(power_cycle, tuple(map(_in_words, reversed(faults))))


def _in_words(fault: wire.LoggedFault) -> LoggedFault:
    return LoggedFault(
        fault.power_cycle,
        fault.tick,
        fault.tick / TICK_HZ,
        name_of(wire.Fault, fault.fault),
        axes_of(1 << fault.axis) if fault.axis != NO_AXIS else "",
        name_of(wire.State, fault.state),
        fault_detail(fault.fault, fault.detail),
    )
