"""faulty:// for pyserial: any port behind a line that goes wrong.

``faulty://PORT#FAULTS``, e.g. ``faulty://sim://xyz250?seed=3#lose=0.01&flip=1e-4&seed=7`` or
``faulty:///dev/ttyACM0#lose=0.001``. The faults are the fields of ``LineFaults``. A device whose cable was pulled
(``unplug``) keeps its power: who opens the same URL again finds it as it is by then.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any
from urllib.parse import parse_qsl

import serial
from serial.serialutil import PortNotOpenError, SerialBase

from phaselead.errors import BadInput
from phaselead.serial_ports import FAULTY, behind_line, open_port
from phaselead.sim.faulty import FaultyLine, LineFaults

_unplugged: dict[str, FaultyLine] = {}
"""Lines that were closed while they were unplugged, by URL."""


def parse_url(url: str) -> tuple[str, LineFaults]:
    """The port behind the line, and what the line does. Raises BadInput with what is wrong with it."""
    inner, text = behind_line(url), url.partition("#")[2]
    if not url.startswith(FAULTY) or not inner or inner.startswith(FAULTY):
        raise BadInput(f"{url}: names no port; one looks like faulty://sim://xyz250#lose=0.01&seed=7")
    kinds = {field.name: int if isinstance(field.default, int) else float for field in fields(LineFaults)}
    options: dict[str, Any] = {}
    for name, value in parse_qsl(text, keep_blank_values=True):
        if name not in kinds:
            raise BadInput(f"{url}: {name!r} is no fault; there are {', '.join(kinds)}")
        try:
            options[name] = kinds[name](value)
        except ValueError:
            options[name] = math.nan
        if options[name] != options[name]:
            raise BadInput(f"{url}: {name} must be a number, not {value!r}")
    try:
        return inner, LineFaults(**options)
    except BadInput as error:
        raise BadInput(f"{url}: {error}") from None


class Serial(SerialBase):  # type: ignore[misc]
    """A serial port behind a ``FaultyLine``; ``line`` is that."""

    is_open: bool

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._line: FaultyLine | None = None
        super().__init__(*args, **kwargs)

    @property
    def line(self) -> FaultyLine:
        """What goes wrong. Raises PortNotOpenError."""
        if self._line is None:
            raise PortNotOpenError
        return self._line

    def open(self) -> None:
        if self._port is None:
            raise serial.SerialException("no port given; use faulty://sim://xyz250#lose=0.01")
        if self.is_open:
            raise serial.SerialException("the port is already open")
        inner, faults = parse_url(self._port)
        line = _unplugged.pop(self._port, None)
        if line is None:
            line = FaultyLine(open_port(inner, baud=self._baudrate), faults)
        line.plug_in()
        self._line = line
        self.is_open = True
        self._reconfigure_port()

    def close(self) -> None:
        if self._line is not None:
            if self._line.plugged:
                self._line.port.close()
            else:
                _unplugged[self._port] = self._line
        self._line = None
        self.is_open = False

    def _reconfigure_port(self, force_reconfig: bool = False) -> None:
        self.line.timeout = self._timeout

    def read(self, size: int = 1) -> bytes:
        return self.line.read(size)

    def write(self, data: Any) -> int:
        return self.line.write(bytes(data))

    @property
    def in_waiting(self) -> int:
        return self.line.in_waiting

    def __getattr__(self, name: str) -> Any:
        """All else is the port's behind the line: virtual time, true positions."""
        line = self.__dict__.get("_line")
        if line is None or name.startswith("_"):
            raise AttributeError(name)
        return getattr(line.port, name)

    def _update_dtr_state(self) -> None:
        """Nothing may hang on DTR."""

    def _update_rts_state(self) -> None:
        """Nothing may hang on RTS."""
