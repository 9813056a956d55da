"""What a command loads before it begins: nothing that is slow to load and that it does not use."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

SLOW = {"scipy", "h5py", "matplotlib", "pandas", "pyarrow", "multiprocessing"}
COMMAND = "from phaselead.cli import main; main({!r}, standalone_mode=False)"


def loaded(code: str) -> set[str]:
    """The top-level modules in a fresh process after ``code``."""
    look = "import json, sys; sys.stderr.write(json.dumps(sorted(sys.modules)))"
    environment = {name: value for name, value in os.environ.items() if name != "PHASELEAD_PORT"}
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\n{look}"], capture_output=True, text=True, check=True, env=environment
    )
    return {module.split(".")[0] for module in json.loads(done.stderr)}


@pytest.mark.parametrize("code", ["import phaselead", COMMAND.format(["--help"]), COMMAND.format(["ports"])])
def test_what_needs_no_arithmetic_loads_no_numerical_library(code):
    assert loaded(code) & (SLOW | {"numpy"}) == set()


@pytest.mark.parametrize("command", ["status", "info", "park"])
def test_a_word_with_the_device_loads_no_library_of_files_figures_or_fits(command):
    assert loaded(COMMAND.format([command])) & SLOW == set()


def test_a_slow_library_would_be_seen():
    assert {"scipy", "multiprocessing"} <= loaded("import multiprocessing, scipy.optimize")
