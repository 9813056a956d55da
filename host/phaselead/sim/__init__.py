"""The same firmware without a board: in this process, on a pseudo-terminal, or the emulated board."""

from __future__ import annotations

from phaselead.sim.device import load_library
from phaselead.sim.emulated import Counts, EmulatedDevice, find_firmware
from phaselead.sim.faulty import FaultyLine, LineFaults
from phaselead.sim.plant import DEFAULT_STAGE, built_in, data_sheet, plant_parameters, stage_at, virtual_stage
from phaselead.sim.pty import linked, serve
from phaselead.sim.replaying import Replay, replay
from phaselead.sim.stack_use import worst_stack

__all__ = [
    "DEFAULT_STAGE",
    "Counts",
    "EmulatedDevice",
    "FaultyLine",
    "LineFaults",
    "Replay",
    "built_in",
    "data_sheet",
    "find_firmware",
    "linked",
    "load_library",
    "plant_parameters",
    "replay",
    "serve",
    "stage_at",
    "virtual_stage",
    "worst_stack",
]
