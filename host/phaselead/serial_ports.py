"""Serial ports, real and simulated, opened so that nothing on the other side twitches.

It stands below the room `device`, so that ports can be listed without loading numpy, the wire and the model.
"""

from __future__ import annotations

import errno
import os
import re
from dataclasses import dataclass
from typing import Protocol
from urllib.parse import parse_qsl

import serial
from serial.tools import list_ports as serial_list_ports

from phaselead.errors import LinkError, PhaseleadError
from phaselead.result import Result, Table

DEFAULT_PORT = "sim://xyz250"
PORT_VARIABLE = "PHASELEAD_PORT"
BAUD = 2_000_000
READ_TIMEOUT_S = 0.05
WRITE_TIMEOUT_S = 2.0
"""A line that takes nothing for so long has nobody at its other end (a pseudo-terminal whose reader has gone)."""


class Port(Protocol):
    """What the link uses of a pyserial port. One whose time is not ours has ``clock_s``: seconds of its own."""

    timeout: float | None

    @property
    def in_waiting(self) -> int: ...
    def read(self, size: int = 1, /) -> bytes: ...
    def write(self, data: bytes, /) -> int | None: ...
    def close(self) -> None: ...


@dataclass(frozen=True)
class PortInfo:
    url: str
    description: str
    serial_number: str


class Ports(Result, list[PortInfo]):
    """Serial ports: a list that prints as a table. Each has ``url``, ``description`` and ``serial_number``."""

    @property
    def columns(self) -> dict[str, list[str]]:
        """One entry for each port: url, description, serial_number."""
        return {name: [getattr(port, name) for port in self] for name in ("url", "description", "serial_number")}

    def tables(self) -> list[Table | str]:
        return [Table(("port", "what it is"), tuple((port.url, port.description) for port in self))]


FAULTY = "faulty://"
"""Begins the URL of a port behind a line that goes wrong: ``faulty://PORT#FAULTS``."""


def behind_line(url: str) -> str:
    """The URL of the device itself, without a line that goes wrong before it."""
    return url.removeprefix(FAULTY).partition("#")[0] if url.startswith(FAULTY) else url


def is_virtual(url: str) -> bool:
    """Whether the device is a simulated or an emulated one: it ends with the program that opened it."""
    return behind_line(url).startswith(("sim://", "qemu://"))


def keeps_flash(url: str) -> bool:
    """Whether what is written to the device's flash outlives the program that opened it."""
    return not is_virtual(url) or "state" in dict(parse_qsl(behind_line(url).partition("?")[2]))


def default_port() -> str:
    """``$PHASELEAD_PORT`` as it is now, else the built-in virtual stage."""
    return os.environ.get(PORT_VARIABLE) or DEFAULT_PORT


def list_ports() -> Ports:
    """Serial ports of this machine. Looks them up without opening any."""
    found = sorted(serial_list_ports.comports(), key=lambda p: p.device)
    return Ports(PortInfo(p.device, p.description or "", p.serial_number or "") for p in found)


def open_port(url: str, *, baud: int = BAUD, timeout_s: float = READ_TIMEOUT_S) -> Port:
    """Opens a device path or a pyserial URL (``sim://...`` included), exclusively.

    DTR and RTS are set low before the port is opened, since on many boards they are the reset line. (Linux
    raises them for an instant in open() itself; no program can prevent that.)

    Raises:
        LinkError: the port is missing, busy, forbidden or no serial port.
    """
    if "phaselead.sim" not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append("phaselead.sim")
    try:
        port = serial.serial_for_url(
            url, do_not_open=True, baudrate=baud, timeout=timeout_s, write_timeout=WRITE_TIMEOUT_S
        )
        if "://" not in url:
            port.exclusive = True
            port.dtr = False
            port.rts = False
        port.open()
    except PhaseleadError:
        raise
    except (serial.SerialException, ValueError, OSError) as error:
        raise LinkError(_explain(url, error)) from None
    opened: Port = port
    return opened


def _explain(url: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number is None and (match := re.search(r"\[Errno (\d+)\]|\((\d+), '", str(error))):
        number = int(match[1] or match[2])
    if isinstance(error, ValueError) and "protocol" in str(error):
        return f"port {url}: unknown kind of port; use a device path or sim://..."
    if "exclusively lock" in str(error) or number in (errno.EBUSY, errno.EAGAIN):
        return f"port {url} is in use by another program; close that program, then try again"
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return f"port {url} does not exist; `phaselead ports` lists those that do"
    if number in (errno.EACCES, errno.EPERM):
        return f"port {url}: no permission; join the group that owns it (often dialout) and log in again"
    if number in (errno.ENOTTY, errno.EINVAL, errno.EISDIR):
        return f"{url} is not a serial port; `phaselead ports` lists them"
    return f"port {url} cannot be opened: {error}"
