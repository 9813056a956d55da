"""qemu:// for pyserial: the board's firmware, emulated, with a simulated stage, in virtual time.

``qemu://nucleo_f446re`` or ``qemu://generic_f405``, with ``?stage=NAME`` or ``?stage=FILE.toml`` for the stage
(xyz250 by default), ``&seed=N``, ``&state=FILE`` to keep the flash, ``&baud=N`` for the line, ``&elf=FILE`` for
another firmware than the one `make firmware` built, ``&delays=0`` for parts that take no time.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from phaselead.device import BAUD
from phaselead.errors import BadInput
from phaselead.sim import protocol_sim
from phaselead.sim.emulated import BOARDS, EmulatedDevice
from phaselead.sim.plant import DEFAULT_STAGE, load_any, plant_parameters
from phaselead.sim.protocol_sim import SimulatedDevice, number_option, read_flash

SCHEME = "qemu://"


@dataclass(frozen=True)
class Place:
    """What a qemu:// URL says."""

    board: str
    stage: str = DEFAULT_STAGE
    seed: int = 0
    state: Path | None = None
    baud: int = BAUD
    elf: Path | None = None
    delays: int = 1


def parse_url(url: str) -> Place:
    """Reads a qemu:// URL. Raises BadInput with what is wrong with it."""
    board, _, query = url.removeprefix(SCHEME).partition("?")
    if not url.startswith(SCHEME) or not board or (BOARDS and board not in BOARDS):
        raise BadInput(f"{url}: names no emulated board; use {' or '.join(SCHEME + name for name in BOARDS)}")
    options: dict[str, Any] = {}
    for name, text in parse_qsl(query, keep_blank_values=True):
        if name == "seed":
            options[name] = number_option(url, name, text, 0, 2**64 - 1)
        elif name == "baud":
            options[name] = number_option(url, name, text, 9600, 100_000_000)
        elif name == "delays":
            options[name] = number_option(url, name, text, 0, 1)
        elif name == "stage" and text:
            options[name] = text
        elif name in ("state", "elf") and text:
            options[name] = Path(text)
        else:
            raise BadInput(f"{url}: {name!r} is no option; there are stage, seed, state, baud, elf and delays")
    return Place(board, **options)


def open_device(place: Place) -> EmulatedDevice:
    """A board just switched on. Raises BadInput for a stage, state file, firmware or emulator that cannot be used."""
    parameters = plant_parameters(load_any(place.stage), place.seed)
    flash = None if place.state is None else read_flash(place.state)
    try:
        delays = bool(place.delays)
        return EmulatedDevice(place.board, parameters, elf=place.elf, flash=flash, baud=place.baud, delays=delays)
    except BadInput as error:
        raise BadInput(f"{SCHEME}{place.board}: {error}") from None


class Serial(protocol_sim.Serial):
    """A serial port whose other end is an emulated board."""

    def _open_device(self, url: str) -> tuple[SimulatedDevice, Path | None]:
        place = parse_url(url)
        return open_device(place), place.state
