"""What the boards' ELF files are made of: no floating point, nothing of flash where flash is busy, a guarded stack."""

import re
import runpy
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from phaselead.device import wire
from phaselead.device.framing import FrameReader, encode_frame
from phaselead.errors import BadInput
from phaselead.sim.device import Firmware
from phaselead.sim.emulated import BOARDS, find_firmware

ROOT = Path(__file__).parents[2]
TOOL = "arm-none-eabi-objdump"
IN_RAM = (
    "core_lost",
    "core_lost_on_fault",
    "core_lost_on_nmi",
    "core_lost_on_stray",
    "erase_sector",
    "name_fault",
    "program_bytes",
    "serial_sent",
    "tick_parked",
    "wait_until_ready",
)
MAY_BE_PART_OF_ANOTHER = {"name_fault", "wait_until_ready"}
"""The compiler decides."""
SOFT_FLOAT = re.compile(r"<__aeabi_[fd](?!2lz)|<__(add|sub|mul|div)[sd]f3|<__fix|<__float")


def functions(elf):
    """Name: (address, lines of its disassembly)."""
    text = subprocess.run(
        [TOOL, "-d", "--section=.text", "--section=.data", elf], capture_output=True, text=True
    ).stdout
    found = re.findall(r"^([0-9a-f]{8}) <([^>]+)>:\n((?:.+\n)+)", text, re.M)
    return {name: (int(address, 16), body.splitlines()) for address, name, body in found}


@pytest.fixture(scope="module", params=BOARDS)
def elf(request):
    if shutil.which(TOOL) is None:
        pytest.skip("no gcc-arm-none-eabi")
    try:
        return find_firmware(request.param)
    except BadInput as error:
        pytest.skip(str(error))


def test_no_instruction_is_a_floating_point_one(elf):
    for name, (_, lines) in functions(elf).items():
        for line in lines:
            assert not re.search(r"\tv(add|sub|mul|div|mov|ldr|str|push|pop|cvt|cmp|ldm|stm|neg|abs)", line), (
                name,
                line,
            )
            assert not SOFT_FLOAT.search(line), (name, line)


def test_what_runs_while_flash_is_busy_is_in_ram_and_stays_there(elf):
    found = functions(elf)
    assert not [name for name in IN_RAM if name in found and found[name][0] >> 24 != 0x20]
    in_ram = [name for name, (address, _) in found.items() if address >> 24 == 0x20]
    assert {name.split(".")[0] for name in in_ram} >= set(IN_RAM) - MAY_BE_PART_OF_ANOTHER
    for name in in_ram:
        lines = found[name][1]
        for line in lines:
            target = re.search(r"\tb(?:l|lx|\.w|[a-z]{2}(?:\.[nw])?)?\t([0-9a-f]{7,8}) <", line)
            assert not target or int(target[1], 16) >> 24 == 0x20, (name, line)
            assert not re.search(r"\.word\t0x080[0-9a-f]{5}$", line), (name, line)  # no address in flash either


def test_the_stack_lies_below_everything_with_its_guard_underneath(elf):
    text = subprocess.run(["arm-none-eabi-nm", elf], capture_output=True, text=True, check=True).stdout
    at = {name: int(address, 16) for address, name in re.findall(r"^([0-9a-f]{8}) \w (\w+)$", text, re.M)}
    assert at["stack_guard_start"] == 0x2000_0000
    assert at["stack_bottom"] == at["stack_guard_start"] + 256
    assert at["stack_top"] <= at["data_start"]
    assert at["zeroed_end"] <= 0x2000_0000 + 128 * 1024


def test_the_board_says_what_it_was_built_from(elf):
    build_id = runpy.run_path(str(ROOT / "firmware" / "build_id.py"))["build_id"]
    if build_id(ROOT).encode() not in elf.read_bytes():
        pytest.skip("the firmware is older than its source; run `make firmware`")
    with Firmware() as firmware:
        reader = FrameReader()
        firmware.write(encode_frame(wire.HEADER.pack(wire.HelloRequest.NUMBER, 1, 1)))
        firmware.run_codes(np.zeros((1, 3), np.uint16))
        (body,) = reader.feed(b"\0" + firmware.read(firmware.readable))
    assert wire.HelloReply.unpack(body[wire.HEADER.size :]).build_id.hex() == build_id(ROOT)
