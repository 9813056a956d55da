"""The inputs that fuzzing has kept, once more: `make fuzz` looks for new ones."""

import os
import subprocess

import pytest
from host_targets import TARGETS as HOST_TARGETS

from fuzz import CORPUS, DEVICE, HERE, INCLUDE, SANITIZE, TARGETS


def test_every_target_has_a_corpus():
    assert sorted(path.name for path in CORPUS.iterdir()) == sorted(TARGETS)
    assert sorted(HOST_TARGETS) == sorted(set(TARGETS) - {"device"})


@pytest.mark.parametrize("target", HOST_TARGETS)
def test_what_the_host_reads(target):
    for path in sorted((CORPUS / target).iterdir()):
        HOST_TARGETS[target](path.read_bytes())


def test_the_device(tmp_path):
    program = tmp_path / "replay"
    command = [os.environ.get("CC", "cc"), "-std=c11", *INCLUDE, *map(str, [HERE / "replay.c", *DEVICE])]
    if subprocess.run([*command, *SANITIZE, "-o", str(program)], capture_output=True, check=False).returncode:
        subprocess.run([*command, "-o", str(program)], check=True)  # a compiler without the sanitizers' libraries
    inputs = sorted(map(str, (CORPUS / "device").iterdir()))
    done = subprocess.run([str(program), *inputs], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
