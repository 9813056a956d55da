"""The memory of a process that searches."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

ALLOCATE = """
import resource, sys
import numpy as np
from phaselead.freed_memory import keep_freed_memory

kept = keep_freed_memory() if sys.argv[1] == "keep" else False
for i in range(4):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    values = np.ones(5_000_000)
    del values
    faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
print(kept, faults)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another library gives memory back in its own way")
def test_what_was_freed_is_not_cleared_again_by_the_system():
    """40 MB are some ten thousand pages, or twenty huge ones."""
    said = {
        word: subprocess.run([sys.executable, "-c", ALLOCATE, word], capture_output=True, text=True, check=True).stdout
        for word in ("keep", "give back")
    }
    (kept, faults), (_, faults_else) = (line.split() for line in said.values())
    assert kept == "True"
    assert int(faults) < 5 < int(faults_else)
