"""The emulated boards; without an emulator or a firmware these tests are left out."""

import runpy
from pathlib import Path

import pytest

from phaselead.errors import BadInput, PhaseleadError
from phaselead.sim.emulated import BOARDS, EmulatedDevice, check_qemu, find_firmware
from phaselead.sim.plant import built_in, plant_parameters

ROOT = Path(__file__).parents[2]


def refuse_stale_firmware():
    """The ELF files must be of the source that is here."""
    build_id = runpy.run_path(str(ROOT / "firmware" / "build_id.py"))["build_id"](ROOT)
    for board in BOARDS:
        if build_id.encode() not in find_firmware(board).read_bytes():
            raise BadInput(f"the firmware of {board} is older than its source; run `make firmware`")


def pytest_collection_modifyitems(items):
    try:
        check_qemu()
        refuse_stale_firmware()
    except PhaseleadError as error:
        for item in items:
            if "emulated" in item.nodeid:
                item.add_marker(pytest.mark.skip(reason=str(error)))


@pytest.fixture(scope="session")
def stage():
    return plant_parameters(built_in("xyz250"))


@pytest.fixture
def start(stage):
    """Starts boards, and switches them off again."""
    boards = []

    def start(board="nucleo_f446re", **how):
        boards.append(EmulatedDevice(board, stage, **how))
        return boards[-1]

    yield start
    for board in boards:
        board.close()
