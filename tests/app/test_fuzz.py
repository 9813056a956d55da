"""The C fuzz driver under the address and undefined-behaviour sanitizers."""

import subprocess

import pytest
from c_driver import build

SANITIZE = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    try:
        return build(folder, "fuzz", *SANITIZE)
    except subprocess.CalledProcessError:  # a compiler without the sanitizers' libraries
        return build(folder, "fuzz")


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
