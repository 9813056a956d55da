"""What the model of cycles charges: instruction by instruction, and for memory. The figures are docs/emulation.md's."""

import ctypes
import re
import shutil
import subprocess
from pathlib import Path

import pytest

EMULATOR = Path(__file__).parents[2] / "host" / "phaselead" / "sim" / "emulator"
CLOCKS = """#include <stdint.h>
uint64_t rcc_sysclk_Hz(void) { return 168000000; }
uint64_t rcc_apb_Hz(unsigned apb) { return apb == 1 ? 42000000 : 84000000; }
"""
INSTRUCTIONS = {
    "adds r0, r1, r2": 1, "add.w r8, r9, r10": 1, "mul r0, r1, r0": 1, "smull r0, r1, r2, r3": 1,
    "smlal r0, r1, r2, r3": 1, "clz r0, r1": 1, "movw r0, #1": 1, "it ne\nmovne r0, r1": 1, "bx lr": 1, "nop": 1,
    "ubfx r0, r1, #2, #3": 1,
    "ldr r0, [r1]": 2, "ldr.w r0, [r1, #400]": 2, "ldrh r0, [r1, r2]": 2, "strb r0, [r1, #1]": 2, "str r0, [sp, #4]": 2,
    "ldr r0, [pc, #4]": 2, "ldrsh.w r8, [r9]": 2, "ldrd r0, r1, [r2]": 3, "strd r0, r1, [r2], #8": 3,
    "ldrex r0, [r1]": 3,
    "push {r4, r5, lr}": 4, "pop {r4, r5, pc}": 4, "push.w {r4-r11, lr}": 10, "ldmia r0!, {r1, r2}": 3,
    "stmia.w r0, {r1, r2, r8}": 4, "sdiv r0, r1, r2": 12, "udiv r0, r1, r2": 12, "dsb": 4, "isb": 4, "cpsid i": 2,
    "mrs r0, primask": 2, "msr primask, r0": 2, "b.w .": 1, "bl .": 1, "cbz r0, .+8": 1, "ssat r0, #16, r1": 1,
}  # fmt: skip


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cycles")
    (folder / "clocks.c").write_text(CLOCKS)
    library = folder / "cycles.so"
    sources = [str(EMULATOR / "cycles.c"), str(folder / "clocks.c")]
    subprocess.run(["cc", "-std=gnu11", "-shared", "-fPIC", f"-I{EMULATOR}", *sources, "-o", str(library)], check=True)
    return ctypes.CDLL(str(library))


def assembled(text, folder):
    """Bytes of the last instruction."""
    if shutil.which("arm-none-eabi-as") is None:
        pytest.skip("no gcc-arm-none-eabi")
    source, made = folder / "a.s", folder / "a.o"
    source.write_text(f".syntax unified\n.thumb\n{text}\n")
    subprocess.run(["arm-none-eabi-as", "-mcpu=cortex-m4", str(source), "-o", str(made)], check=True)
    listing = subprocess.run(
        ["arm-none-eabi-objdump", "-d", str(made)], capture_output=True, text=True, check=True
    ).stdout
    halves = re.findall(r"^\s+[0-9a-f]+:\t([0-9a-f ]+?)\s*\t", listing, re.M)[-1].split()
    return b"".join(int(half, 16).to_bytes(2, "little") for half in halves)


@pytest.mark.parametrize(("text", "cycles"), INSTRUCTIONS.items())
def test_an_instruction(model, tmp_path, text, cycles):
    code = assembled(text, tmp_path)
    assert model.cycles_of(code, len(code)) == cycles


def test_memory(model):
    places = {0x2000_1000: 0, 0x0800_4000: 5, 0x4000_3808: 12, 0x4001_3008: 6, 0x4002_0410: 1, 0xE000_1004: 1}
    assert {at: model.cycles_of_access(at, False) for at in places} == places


def test_the_cache_keeps_the_last_64_lines_that_were_jumped_to(model):
    jump, fetched = model.cycles_of_jump, model.cycles_fetched
    model.cycles_cache_cold()
    lines = [0x0800_0000 + 0x40 * i for i in range(65)]
    assert [jump(at) for at in lines[:64]] == [5] * 64
    assert jump(lines[0]) == 0  # and is now the one used last
    assert jump(lines[64]) == 5  # puts lines[1] out
    assert (jump(lines[0]), jump(lines[2]), jump(lines[1])) == (0, 0, 5)
    fetched(0x0800_8004)
    assert (jump(0x0800_800E), jump(0x2000_0000)) == (0, 0)  # in the line that is there; in RAM
    model.cycles_cache_cold()
    assert jump(lines[0]) == 5
