"""The emulated board: the ELF that a board gets, run by QEMU, with a simulated stage behind its converters."""

from __future__ import annotations

import contextlib
import enum
import os
import re
import shutil
import struct
import subprocess
import tempfile
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from phaselead import interrupt
from phaselead.compiled import library_path
from phaselead.device import BAUD
from phaselead.errors import BadInput, PhaseleadError
from phaselead.sim.device import Codes
from phaselead.sim.plant import PlantParameters
from phaselead.source_tree import boards

BOARDS = boards()
"""Whose firmware `make firmware` builds."""
HARDWARE = re.compile(rb"chip=(F446|F405),usart=([12])")
QEMU = "qemu-system-arm"
QEMU_VERSION = "7.2"
MACHINE = "netduinoplus2"
"""QEMU's STM32F405; the plugin makes it the board."""
FLASH_SIZE, BOOTLOADER_SIZE = 512 * 1024, 16 * 1024
KEPT_SIZE = FLASH_SIZE - BOOTLOADER_SIZE
"""Of a flash image: images, models and records, all but the bootloader."""
FLASH_BASE = 0x0800_0000
BOOT_TICKS = 100
"""Time for the firmware to come up, in ticks of 200 us."""
TICKS_AT_ONCE = 5000
"""About half a second: so long an interrupt may have to wait."""
_BROKEN = 0xFFFF_FFFF
_LOADED = 1
"""Of an ELF file's segments."""


class _Ask(enum.IntEnum):
    """enum ask of emulator/world.c."""

    STAGE = 1
    RUN = 2
    WRITE = 3
    BAUD = 4
    INJECT = 5
    FLASH = 6
    TRACE = 7
    TAKE_TRACE = 8
    CODES = 9
    COUNTS = 10
    PEEK = 11
    POKE = 12
    TIME = 13


class Injection(enum.IntEnum):
    """enum injection of emulator/board.h."""

    CRYSTAL_STOPS = 1
    NO_CRYSTAL = 2
    ADC_SILENT = 3
    DAC_SILENT = 4
    INTERLOCK = 5
    BROWN_OUT = 6
    NOISE = 7
    RAIL = 8
    FLASH_CUT = 9
    RESET_PIN = 10
    ADC_CONFUSED = 11
    NO_CONVERSION = 12
    BOR_LEVEL = 13
    SUPPLY_LOW = 14
    FROZEN = 15
    TRIGGER = 16


def find_firmware(board: str) -> Path:
    """The ELF that `make firmware` left in the source tree. Raises BadInput when there is none."""
    for root in (Path(__file__).resolve().parents[3], Path.cwd()):
        elf = root / ".pio" / "build" / board / "firmware.elf"
        if elf.is_file():
            return elf
    raise BadInput(f"there is no firmware for {board} yet; run `make firmware` in the source tree, or give ?elf=FILE")


def hardware_of(elf: Path, board: str) -> str:
    """Chip and serial port that a firmware is for, as it says itself. Raises BadInput when it is for another board."""
    firmware = elf.read_bytes()
    found = HARDWARE.search(firmware)
    if found is None or board.encode() not in firmware:
        raise BadInput(f"{elf}: is no firmware for {board}; build it with `make firmware`")
    return found.group().decode("ascii")


def flash_contents(elf: bytes, kept: bytes | None = None) -> bytes:
    """What is in flash once a debugger has written an ELF file, or beside its bootloader what was ``kept``."""
    cells = bytearray(b"\xff" * FLASH_SIZE)
    (table,), (entry_size, count) = struct.unpack_from("<I", elf, 28), struct.unpack_from("<HH", elf, 42)
    for at in range(table, table + entry_size * count, entry_size):
        kind, offset, _, address, size = struct.unpack_from("<5I", elf, at)
        if kind == _LOADED and size:
            cells[address - FLASH_BASE : address - FLASH_BASE + size] = elf[offset : offset + size]
    return bytes(cells) if kept is None else bytes(cells[:BOOTLOADER_SIZE]) + kept


def _plugin() -> str:
    built = library_path("phaselead.sim._emulator")
    if built is None:
        raise PhaseleadError("the emulated board is not built; it needs Linux and a C compiler (`make setup`)")
    return str(built)


def _stage_library() -> str:
    built = library_path("phaselead.sim._firmware")
    if built is None:
        raise PhaseleadError("the firmware library is not built; run `make setup`")
    return str(built)


def check_qemu() -> str:
    """The emulator's path. Raises BadInput when it is missing or of another version than the model was made for."""
    path = shutil.which(QEMU)
    if path is None:
        raise BadInput(f"{QEMU} is not installed; the emulated board needs its version {QEMU_VERSION} (Debian 12's)")
    said = subprocess.run([path, "--version"], capture_output=True, text=True, check=False).stdout
    match = re.search(r"version (\d+\.\d+)", said)
    version = match[1] if match else "unknown"
    if version != QEMU_VERSION:
        raise BadInput(f"{path} is version {version}; the emulated board is made for {QEMU_VERSION} (Debian 12's)")
    return path


class EmulatedStage:
    """Where the stage truly is."""

    def __init__(self, device: EmulatedDevice) -> None:
        self._device = device

    def trace(self, capacity: int) -> None:
        """Keeps true positions from now on, the last ``capacity`` ticks of them; 0 stops."""
        self._device.ask(_Ask.TRACE, struct.pack("<Q", capacity))

    def take_trace(self) -> tuple[int, NDArray[np.float64]]:
        """First tick, and true positions in um, shape (n, 3), since the last call."""
        answer = self._device.ask(_Ask.TAKE_TRACE)
        return int.from_bytes(answer[:8], "little"), np.frombuffer(answer, np.float64, offset=8).reshape(-1, 3).copy()


class Counts(NamedTuple):
    """Runs of an interrupt, the most of any of them, and the longest time for which interrupts were locked."""

    runs: int
    instructions: int
    cycles: int
    cycles_to_mark: int
    locked_cycles: int


class EmulatedDevice:
    """A board in QEMU. Its time passes in ``run`` alone, so a run is the same every time.

    Args:
        board: one of ``BOARDS``.
        parameters: of the stage.
        elf: the firmware; by default what `make firmware` built.
        flash: what an earlier board left behind its bootloader, ``KEPT_SIZE`` bytes; by default what a debugger
            writes with the firmware, and nothing else.
        baud: speed of the host's end of the line.
        delays: the parts take as long as their data sheets allow; by default unless cycles are counted, which has its
            own model of them.
        count: places between which instructions and cycles are counted, see emulator/count.c.
        boot: let the firmware come up first.

    Raises:
        BadInput: an unknown board, no firmware, no fitting QEMU, a flash image of another size.
    """

    def __init__(
        self,
        board: str,
        parameters: PlantParameters,
        *,
        elf: Path | None = None,
        flash: bytes | None = None,
        baud: int = BAUD,
        count: str | None = None,
        delays: bool | None = None,
        boot: bool = True,
    ) -> None:
        if BOARDS and board not in BOARDS:
            raise BadInput(f"there is no emulated board {board!r}; there are {' and '.join(BOARDS)}")
        if flash is not None and len(flash) != KEPT_SIZE:
            raise BadInput("the flash image has the wrong size; give one that an emulated board wrote, or none")
        self._process: subprocess.Popen[bytes] | None = None
        self._start(board, elf or find_firmware(board), flash, count, count is None if delays is None else delays)
        self._buffer = bytearray()
        self._flash: tuple[bytes, int] | None = None
        self._flash_changes = 0
        self.pulses: NDArray[np.bool_] = np.empty((0, 3), bool)
        """Whether each trigger output's pin rose in the ticks of the last ``codes``, shape (n, 3)."""
        self.plant = EmulatedStage(self)
        self._send_stage(parameters)
        self.ask(_Ask.BAUD, struct.pack("<I", baud))
        if boot:
            self.run(BOOT_TICKS)

    def _start(self, board: str, elf: Path, flash: bytes | None, count: str | None, delays: bool) -> None:
        if not elf.is_file():
            raise BadInput(f"{elf}: there is no such firmware")
        down, to_board = os.pipe()
        from_board, up = os.pipe()
        plugin = (
            f"{_plugin()},in={down},out={up},library={_stage_library()},{hardware_of(elf, board)},delays={delays:d}"
        )
        if count is not None:
            plugin += f",count={count}"
        self._flashed = tempfile.NamedTemporaryFile(suffix=".bin")  # noqa: SIM115
        self._flashed.write(flash_contents(elf.read_bytes(), flash))
        self._flashed.flush()
        self._said = tempfile.TemporaryFile()  # noqa: SIM115
        machine = ["-M", MACHINE, "-nodefaults", "-display", "none", "-serial", "none", "-monitor", "none"]
        self._process = subprocess.Popen(
            [check_qemu(), *machine, "-icount", "shift=3,sleep=off", "-kernel", self._flashed.name, "-plugin", plugin],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._said,
            pass_fds=(down, up),
            start_new_session=True,  # Ctrl-C is for us, who park first
        )
        os.close(down)
        os.close(up)
        self._to_board = os.fdopen(to_board, "wb")
        self._from_board = os.fdopen(from_board, "rb")

    def _send_stage(self, parameters: PlantParameters) -> None:
        stage = bytes(parameters)
        linked = bytes(parameters.linked.contents) if parameters.linked else b""
        head = struct.pack("<II", len(stage), type(parameters).linked.offset)
        if self.ask(_Ask.STAGE, head + stage + linked) != b"\1":
            raise BadInput("the stage cannot be simulated: a time constant, frequency or delay is out of bounds")

    def close(self) -> None:
        """Switches it off."""
        if self._process is None:
            return
        for stream in (self._to_board, self._from_board):
            with contextlib.suppress(OSError):
                stream.close()
        self._process.kill()
        self._process.wait()
        self._said.close()
        self._flashed.close()
        self._process = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __del__(self) -> None:
        if getattr(self, "_process", None):
            self.close()

    def _read(self, size: int) -> bytes:
        data = self._from_board.read(size)
        if len(data) < size:
            raise PhaseleadError(f"the emulated board stopped: {self._last_words()}")
        return data

    def _last_words(self) -> str:
        self._said.seek(0)
        said = self._said.read().decode("utf-8", "replace").strip()
        return said.splitlines()[-1] if said else "it said nothing"

    def ask(self, what: _Ask, payload: bytes = b"") -> bytes:
        """One exchange with the plugin.

        Raises:
            PhaseleadError: the emulator is gone, the board broken, or an earlier exchange was cut short.
        """
        if self._process is None:
            raise PhaseleadError("the emulated board is switched off")
        with interrupt.held(once=True):  # so that the board can still be parked
            try:
                return self._exchange(what, payload)
            except BaseException:  # half an exchange would be taken for the next one's answer
                self.close()
                raise

    def _exchange(self, what: _Ask, payload: bytes) -> bytes:
        try:
            self._to_board.write(struct.pack("<IB", len(payload), what) + payload)
            self._to_board.flush()
        except OSError:
            raise PhaseleadError(f"the emulated board stopped: {self._last_words()}") from None
        size = int.from_bytes(self._read(4), "little")
        if size == _BROKEN:
            text = self._read(int.from_bytes(self._read(4), "little")).decode("utf-8", "replace")
            raise PhaseleadError(f"emulated board: {text}")
        return self._read(size)

    # ---------------------------------------------------------------- the line and time

    def run(self, ticks: int, want_bytes: int = 0) -> int:
        """Runs up to ``ticks`` times 200 us, or until ``want_bytes`` (not 0) are readable. Gives those run."""
        done = 0
        while done < ticks and not (want_bytes and len(self._buffer) >= want_bytes):
            done += self._run(min(ticks - done, TICKS_AT_ONCE), want_bytes)
        return done

    def _run(self, ticks: int, want_bytes: int) -> int:
        want = want_bytes - len(self._buffer) if want_bytes else 0
        answer = self.ask(_Ask.RUN, struct.pack("<QQ", ticks, want))
        ran, self._flash_changes = struct.unpack_from("<QQ", answer)
        self._buffer += answer[16:]
        return int(ran)

    @property
    def readable(self) -> int:
        return len(self._buffer)

    def read(self, size: int) -> bytes:
        """What has left the device, at most ``size`` bytes."""
        data = bytes(self._buffer[:size])
        del self._buffer[:size]
        return data

    def write(self, data: bytes) -> int:
        self.ask(_Ask.WRITE, data)
        return len(data)

    # ---------------------------------------------------------------- what only an emulator lets one do

    def flash(self) -> tuple[bytes, int]:
        """Image of all sectors but the bootloader's, and how often they have been written to."""
        if self._flash is None or self._flash[1] != self._flash_changes:
            self._flash = self.ask(_Ask.FLASH), self._flash_changes
        return self._flash

    def inject(self, what: Injection, value: int = 1) -> None:
        """Makes a fault happen in the hardware."""
        self.ask(_Ask.INJECT, struct.pack("<II", what, value))

    def codes(self) -> tuple[Codes, Codes]:
        """ADC and DAC codes, shape (n, 3) each, of the ticks since the last call."""
        rows = np.frombuffer(self.ask(_Ask.CODES), np.uint16).reshape(-1, 3, 3)
        self.pulses = rows[:, 2].astype(bool)
        return rows[:, 0].copy(), rows[:, 1].copy()

    def counts(self) -> Counts:
        """What was counted since the last call."""
        return Counts(*struct.unpack("<5Q", self.ask(_Ask.COUNTS)))

    def peek(self, address: int, size: int) -> bytes:
        return self.ask(_Ask.PEEK, struct.pack("<II", address, size))

    def poke(self, address: int, data: bytes) -> None:
        """Writes to memory, to the program in flash too."""
        self.ask(_Ask.POKE, struct.pack("<I", address) + data)

    def time(self) -> tuple[int, int]:
        """Nanoseconds since power-on, and ticks of the timer."""
        ns, ticks = struct.unpack("<2Q", self.ask(_Ask.TIME))
        return ns, ticks
