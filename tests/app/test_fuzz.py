"""The C fuzz driver under the address and undefined-behaviour sanitizers."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = [*ROOT.glob("firmware/core/*.c"), *ROOT.glob("firmware/app/*.c"), ROOT / "firmware/port/host/flash.c"]
SANITIZE = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    path = tmp_path_factory.mktemp("fuzz") / "fuzz"
    command = [os.environ.get("CC", "cc"), "-std=c11", "-Wall", "-Wextra", "-Werror", f"-I{ROOT / 'firmware'}"]
    command += [str(Path(__file__).with_name("fuzz.c")), *map(str, SOURCES), "-o", str(path)]
    if subprocess.run([*command, *SANITIZE], capture_output=True, text=True, check=False).returncode:
        subprocess.run(command, check=True)  # a compiler without the sanitizers' libraries
    return path


@pytest.mark.parametrize("seed", range(4))
def test_nothing_a_host_sends_does_worse_than_an_error_reply(driver, seed):
    done = subprocess.run([driver, str(seed), "20000"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    frames, replies, ok, ticks, running, inverse, faults = map(int, done.stdout.split())
    # The driver must have got somewhere, or it proves nothing.
    assert replies > frames // 2
    assert ok > frames // 10
    assert ticks > 100_000
    assert running > ticks // 20
    assert inverse > running // 20
    assert faults > 100
