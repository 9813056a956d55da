"""What a device says of itself, in words."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import IntEnum
from typing import Any, Self

from phaselead.device import wire
from phaselead.device.stream import axes_of
from phaselead.result import Result, Table, pairs_table

NO_AXIS = 255


@dataclass(frozen=True)
class DeviceStatus(Result):
    """STATUS in words; prints as a table. Axis letters stand for masks; tuples are x, y, z. Modes
    are called as a user writes them: inverse+pid."""

    tick: int
    state: str
    fault: str
    fault_axis: str
    fault_tick: int
    running_axes: str
    at_rest: str
    modes: tuple[str, ...]
    adc_codes: tuple[int, ...]
    dac_codes: tuple[int, ...]
    saturations: tuple[int, ...]
    overruns: int
    stream_dropped: int
    rx_errors: int
    model_crc: str

    @classmethod
    def of(cls, r: wire.StatusReply) -> Self:
        """The reply in words."""
        return cls(
            tick=r.tick,
            state=name_of(wire.State, r.state),
            fault=name_of(wire.Fault, r.fault),
            fault_axis=axes_of(1 << r.fault_axis) if r.fault_axis != NO_AXIS else "",
            fault_tick=r.fault_tick,
            running_axes=axes_of(r.running_axes),
            at_rest=axes_of(r.at_rest),
            modes=tuple(name_of(wire.Mode, mode).replace("_", "+") for mode in r.modes),
            adc_codes=r.adc_codes,
            dac_codes=r.dac_codes,
            saturations=r.saturations,
            overruns=r.overruns,
            stream_dropped=r.stream_dropped,
            rx_errors=r.rx_errors,
            model_crc=f"{r.model_crc:08x}",
        )

    def as_dict(self) -> dict[str, Any]:
        """For printing and for JSON."""
        return asdict(self)

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One row."""
        return {name: [value] for name, value in self.as_dict().items()}

    def tables(self) -> list[Table | str]:
        return [pairs_table(self.as_dict())]


def name_of(kind: type[IntEnum], value: int) -> str:
    """The name of a value of an enumeration of the wire, or that it has none here."""
    return kind(value).name.lower() if value in list(kind) else f"unknown ({value})"


def target_of(field: bytes) -> str:
    """The board of a firmware, from its field of fixed width."""
    return field.rstrip(b"\0").decode("ascii", "replace")


def fault_detail(fault: int, detail: int) -> int | str:
    """As a number, but for core_lost: what ended the program, and where."""
    if fault != wire.Fault.CORE_LOST:
        return detail
    loss, address = name_of(wire.CoreLoss, detail >> 28), detail & 0x0FFFFFFF
    return f"{loss} at 0x{address:08x}" if address else loss
