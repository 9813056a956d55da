"""sim:// for pyserial: the firmware with a simulated stage, in virtual time.

``sim://xyz250`` or ``sim://FILE.toml`` (``sim:///absolute/FILE.toml``), with ``?seed=N`` for the sensor
noise, ``&state=FILE`` to keep the flash from one opening to the next, ``&baud=N`` for the line, ``&force=x:1um@2s``
for a force that pushes the stage, as static displacement, from 2 s after the opening on (any number; they add up),
``&trigger=2s`` for an edge at the trigger input 2 s after the opening (any number).
Each opening is a fresh device at rest. Time passes only in reads: until the bytes asked for are there, or the timeout
is over.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from urllib.parse import parse_qsl, unquote

import numpy as np
import serial
from numpy.typing import NDArray
from serial.serialutil import PortNotOpenError, SerialBase

from phaselead.device import BAUD, TICK_HZ
from phaselead.errors import BadInput
from phaselead.record import atomic_path
from phaselead.sim.device import VirtualDevice
from phaselead.sim.plant import load_any, plant_parameters

SCHEME = "sim://"
TURN_TICKS = 50_000
"""A read without a timeout comes up for air this often, so that Ctrl-C works."""
TRACE_TICKS = 4_000_000


class Force(NamedTuple):
    """A force on the stage itself from ``at_s`` after the opening on, as um of static displacement."""

    axis: str
    um: float
    at_s: float


@dataclass(frozen=True)
class SimUrl:
    """What a sim:// URL says."""

    stage: str
    seed: int = 0
    state: Path | None = None
    baud: int = BAUD
    forces: tuple[Force, ...] = ()
    edges_s: tuple[float, ...] = ()
    """At the trigger input, after the opening."""


def number_option(url: str, name: str, text: str, low: int, high: int) -> int:
    try:
        value = int(text)
    except ValueError:
        value = low - 1
    if not low <= value <= high:
        raise BadInput(f"{url}: {name} must be a whole number from {low} to {high}, not {text!r}")
    return value


def force_option(url: str, text: str) -> Force:
    match = re.fullmatch(r"([xyz]):([+-]?[\d.]+(?:e[+-]?\d+)?)um@([\d.]+)s", text.strip())
    try:
        if match is not None:
            return Force(match[1], float(match[2]), float(match[3]))
    except ValueError:
        pass
    raise BadInput(f"{url}: force {text!r} makes no sense; write it as force=x:1um@2s, um of static displacement")


def trigger_option(url: str, text: str) -> float:
    match = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)(ms|s)", text.strip())
    if match is None:
        raise BadInput(f"{url}: trigger {text!r} makes no sense; write it as trigger=2s, an edge at the trigger input")
    return float(match[1]) * (1e-3 if match[2] == "ms" else 1.0)


def parse_url(url: str) -> SimUrl:
    """Reads a sim:// URL. Raises BadInput with what is wrong with it."""
    if not url.startswith(SCHEME):
        raise BadInput(f"{url}: is no simulated port; one looks like sim://xyz250")
    stage, _, query = url[len(SCHEME) :].partition("?")
    options: dict[str, Any] = {}
    for name, text in parse_qsl(query, keep_blank_values=True):
        if name == "seed":
            options[name] = number_option(url, name, text, 0, 2**64 - 1)
        elif name == "baud":
            options[name] = number_option(url, name, text, 9600, 100_000_000)
        elif name == "state" and text:
            options[name] = Path(text)
        elif name == "force":
            options["forces"] = (*options.get("forces", ()), force_option(url, text))
        elif name == "trigger":
            options["edges_s"] = (*options.get("edges_s", ()), trigger_option(url, text))
        else:
            raise BadInput(
                f"{url}: {name!r} is no option; there are seed=N, state=FILE, baud=N, force=x:1um@2s and trigger=2s"
            )
    if not stage:
        raise BadInput(f"{url}: names no stage; use sim://xyz250 or sim://FILE.toml")
    return SimUrl(unquote(stage), **options)


def read_flash(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BadInput(f"{path}: the state file cannot be read ({error.strerror}); name another") from None


def open_device(parsed: SimUrl) -> VirtualDevice:
    """A fresh device at rest. Raises BadInput for a stage or state file that cannot be used."""
    parameters = plant_parameters(load_any(parsed.stage), parsed.seed)
    flash = None if parsed.state is None else read_flash(parsed.state)
    try:
        device = VirtualDevice(parameters, baud=parsed.baud, flash=flash)
    except BadInput as error:
        raise BadInput(f"{parsed.state}: {error}") from None
    for force in parsed.forces:
        device.plant.push("xyz".index(force.axis), force.um, round(force.at_s * TICK_HZ))
    for edge_s in parsed.edges_s:
        device.trigger_at(round(edge_s * TICK_HZ))
    return device


class TracedStage(Protocol):
    """A simulated stage that can say where it truly is."""

    def trace(self, capacity: int) -> None: ...
    def take_trace(self) -> tuple[int, NDArray[np.float64]]: ...


class SimulatedDevice(Protocol):
    """What a simulated port has at its other end; its time passes in ``run``."""

    @property
    def plant(self) -> TracedStage: ...
    @property
    def readable(self) -> int: ...
    def run(self, ticks: int, want_bytes: int = 0) -> int: ...
    def read(self, size: int) -> bytes: ...
    def write(self, data: bytes) -> int: ...
    def flash(self) -> tuple[bytes, int]: ...
    def close(self) -> None: ...


class FlashKeeper:
    """Writes a device's flash to its state file whenever it has changed."""

    def __init__(self, device: SimulatedDevice, path: Path | None) -> None:
        self._device, self._path = device, path
        self._writes = 0

    def keep(self) -> None:
        if self._path is None:
            return
        image, writes = self._device.flash()
        if writes != self._writes:
            with atomic_path(self._path) as path:
                path.write_bytes(image)
            self._writes = writes


class Serial(SerialBase):  # type: ignore[misc]
    """A serial port whose other end is a simulated device."""

    is_open: bool

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._device: SimulatedDevice | None = None
        self._keeper: FlashKeeper | None = None
        self._ran = 0
        """Ticks since it was opened."""
        self._seen = 0
        """Bytes there were at the last look at ``in_waiting``."""
        super().__init__(*args, **kwargs)

    def open(self) -> None:
        if self._port is None:
            raise serial.SerialException("no port given; use sim://xyz250 or sim://FILE.toml")
        if self.is_open:
            raise serial.SerialException("the port is already open")
        self._device, state = self._open_device(self._port)
        self._keeper = FlashKeeper(self._device, state)
        self.is_open = True

    def _open_device(self, url: str) -> tuple[SimulatedDevice, Path | None]:
        """A fresh device, and the file that keeps its flash."""
        parsed = parse_url(url)
        return open_device(parsed), parsed.state

    def close(self) -> None:
        if self._device is not None:
            if self._keeper is not None:
                self._keeper.keep()
            self._device.close()
        self._device = self._keeper = None
        self.is_open = False

    @property
    def device(self) -> SimulatedDevice:
        """What is at the other end. Raises PortNotOpenError."""
        if self._device is None:
            raise PortNotOpenError
        return self._device

    @property
    def clock_s(self) -> float:
        """Virtual time since it was opened."""
        return self._ran / TICK_HZ

    def _run(self, ticks: int, want_bytes: int = 0) -> int:
        done = self.device.run(ticks, want_bytes)
        self._ran += done
        return done

    def _timeout_ticks(self) -> int | None:
        return None if self._timeout is None else round(self._timeout * TICK_HZ)

    def read(self, size: int = 1) -> bytes:
        """Runs the device until ``size`` bytes are there or the timeout has passed in virtual time."""
        device = self.device
        left = self._timeout_ticks()
        chunks: list[bytes] = []
        missing = size
        while missing > 0:
            ticks = TURN_TICKS if left is None else left
            want = min(missing, 1 << 19)
            done = self._run(ticks, want)
            chunk = device.read(missing)
            chunks.append(chunk)
            missing -= len(chunk)
            if left is not None:
                left -= done
                if left <= 0 and len(chunk) < want:
                    break
        if self._keeper is not None:
            self._keeper.keep()
        return b"".join(chunks)

    def write(self, data: Any) -> int:
        return self.device.write(bytes(data))

    @property
    def in_waiting(self) -> int:
        """Bytes there are. When there are no more than at the last look a tick passes, so that polling ends."""
        device = self.device
        if device.readable <= self._seen:
            self._run(1)
        self._seen = device.readable
        return self._seen

    def advance(self, seconds: float) -> None:
        """Lets virtual time pass without reading."""
        self._run(round(seconds * TICK_HZ))

    def trace_true_positions(self, ticks: int = TRACE_TICKS) -> None:
        """Keeps where the stage truly is, for the last ``ticks`` ticks; 0 stops."""
        self.device.plant.trace(ticks)

    def true_positions(self) -> tuple[int, NDArray[np.float64]]:
        """First tick, and true positions in um, shape (n, 3), of the ticks since the last call."""
        return self.device.plant.take_trace()

    def flush(self) -> None:
        self._require_open()

    def reset_input_buffer(self) -> None:
        device = self.device
        device.read(device.readable)

    def reset_output_buffer(self) -> None:
        self._require_open()

    @property
    def out_waiting(self) -> int:
        self._require_open()
        return 0

    def _require_open(self) -> None:
        if not self.is_open:
            raise PortNotOpenError

    def _reconfigure_port(self, force_reconfig: bool = False) -> None:
        """Speed and format mean nothing here; the line's speed is in the URL."""

    def _update_dtr_state(self) -> None:
        """Nothing hangs on DTR: opening must not reset anything."""

    def _update_rts_state(self) -> None:
        """Nothing hangs on RTS."""

    def _update_break_state(self) -> None:
        """There is no break."""

    @property
    def cts(self) -> bool:
        return True

    @property
    def dsr(self) -> bool:
        return True

    @property
    def ri(self) -> bool:
        return False

    @property
    def cd(self) -> bool:
        return True
