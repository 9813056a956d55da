"""No byte beside what it was given is touched by the kernel that asks how much room it needs: by the compiler's
sanitizers."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODEL = ROOT / "host" / "phaselead" / "model"
SANITIZE = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Path:
    program = tmp_path_factory.mktemp("columns") / "driver"
    sources = [Path(__file__).with_name("columns_driver.c"), MODEL / "columns_behind_modes.c"]
    flags = ["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", f"-I{MODEL}"]

    def build(*more: str) -> None:
        subprocess.run(
            [os.environ.get("CC", "cc"), *flags, *more, *sources, "-o", program, "-lm"], check=True, capture_output=True
        )

    try:
        build(*SANITIZE)
    except subprocess.CalledProcessError:  # a compiler without the sanitizers' libraries
        build()
    return program


def test_memory_is_in_order(driver: Path) -> None:
    done = subprocess.run([driver], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    assert int(done.stdout) == 20000
