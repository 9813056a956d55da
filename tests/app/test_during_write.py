"""A fault that comes while flash is written."""

import os
import subprocess
from pathlib import Path

import pytest
from device_bench import ZERO_V_CODE
from test_fuzz import SOURCES

from phaselead.device import wire

ROOT = Path(__file__).parents[2]
TWO_V, FIVE_V = 2 * 3200, 5 << 24


@pytest.fixture(scope="module")
def during_write(tmp_path_factory):
    path = tmp_path_factory.mktemp("during_write") / "during_write"
    flags = ["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", f"-I{ROOT / 'firmware'}"]
    source = str(Path(__file__).with_name("during_write.c"))
    command = [os.environ.get("CC", "cc"), *flags, source, *map(str, SOURCES), "-o", str(path)]
    subprocess.run(command, check=True)

    def run(fault):
        told = subprocess.run([path, str(int(fault))], capture_output=True, text=True, check=True).stdout
        return [tuple(map(int, line.split())) for line in told.splitlines()]

    return run


@pytest.mark.parametrize(
    ("fault", "ends_at"), [(wire.Fault.INTERLOCK, 0), (wire.Fault.FLASH_ERROR, TWO_V), (wire.Fault.NONE, TWO_V)]
)
def test_limits_apply_and_the_reaction_of_a_fault_goes_on(during_write, fault, ends_at):
    (state, _, u_max_q24), (_, code, _) = during_write(fault)
    assert state == (wire.State.PARKED if fault == wire.Fault.NONE else wire.State.FAULT)
    assert FIVE_V <= u_max_q24 < FIVE_V + 10_000
    assert code - ZERO_V_CODE == ends_at
