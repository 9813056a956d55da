"""``import phaselead`` is quick, changes nothing, and offers what its ``__all__`` says."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import phaselead as pl

SLOW = ("numpy", "scipy", "matplotlib", "h5py", "pyarrow", "pandas", "pydantic", "serial", "click")


def run(program: str) -> str:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout


def test_it_loads_nothing_slow() -> None:
    loaded = run("import sys, phaselead; dir(phaselead); print(*{name.split('.')[0] for name in sys.modules})").split()
    assert set(loaded) & set(SLOW) == set()


def test_it_leaves_the_environment_alone() -> None:
    program = """
import os
before = dict(os.environ)
import phaselead as pl
pl.fit, pl.gap, pl.connect, pl.GapResult
print(before == dict(os.environ))
"""
    assert run(program).strip() == "True"


def test_names() -> None:
    assert dir(pl) == sorted(pl.__all__)
    assert all(hasattr(pl, name) for name in pl.__all__)
    assert not hasattr(pl, "nothing_of_the_kind")


def test_editors_see_the_names_that_are_loaded_late() -> None:
    """The imports that type checkers read, and the table that is used."""
    tree = ast.parse(Path(str(pl.__file__)).read_text())
    seen = {
        alias.name: str(node.module).removeprefix("phaselead.")
        for branch in tree.body
        if isinstance(branch, ast.If)
        for node in branch.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    used = {name: pl._ROOM_OF.get(name, "api") for name in pl.__all__ if not name.startswith("__")}
    assert seen == used


def test_functions_are_not_hidden_by_rooms_of_their_name() -> None:
    program = """
import phaselead.gap, phaselead.sim, phaselead.demo
from phaselead.gap import run_gap
import phaselead as pl
print(*(callable(one) for one in (pl.gap, pl.sim, pl.demo, run_gap)))
"""
    assert run(program).split() == ["True"] * 4
