"""The page of the public names is the one that the docstrings give, and the pages' Python is true."""

from __future__ import annotations

import ast
import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import phaselead as pl
from phaselead.api.page import NAME, main, page

ROOT = Path(__file__).parents[2]
NOTEBOOKS = [f"docs/notebooks/{path.name}" for path in sorted((ROOT / "docs/notebooks").glob("*.ipynb"))]


def test_the_page_is_up_to_date() -> None:
    assert main(["--check", str(ROOT / "docs")]) == 0


def test_a_stale_page_is_seen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--check", str(tmp_path)]) == 1
    (tmp_path / NAME).write_text(page() + "x")
    assert main(["--check", str(tmp_path)]) == 1
    assert main([str(tmp_path)]) == main(["--check", str(tmp_path)]) == 0
    assert "is stale; run: python -m phaselead.api.page" in capsys.readouterr().err


def test_every_public_name_has_its_section() -> None:
    headings = set(re.findall(r"^## (?:class )?(\w+)$", page(), re.MULTILINE))
    assert headings == {name for name in pl.__all__ if not name.startswith("__")}


def python_of(page: Path) -> list[str]:
    """The Python blocks of a page, or the cells of a notebook."""
    text = page.read_text("utf-8")
    if page.suffix == ".ipynb":
        return ["".join(cell["source"]) for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


def calls(page: Path) -> Iterator[tuple[str, ast.Call]]:
    """Every call of pl.NAME or dev.NAME in the Python of a page."""
    for block in python_of(page):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                owner = node.func.value
                if isinstance(owner, ast.Name) and owner.id in ("pl", "dev"):
                    yield f"{owner.id}.{node.func.attr}", node


@pytest.mark.parametrize("name", ["README.md", "docs/python.md", "docs/start.md", *NOTEBOOKS])
def test_the_calls_that_pages_show_can_be_made(name: str) -> None:
    """Each fits the signature of what it calls."""
    found = list(calls(ROOT / name))
    assert found
    for path, call in found:
        owner, attribute = path.split(".")
        function = getattr(pl if owner == "pl" else pl.Controller, attribute)
        given = [None] * (len(call.args) + (owner == "dev"))
        inspect.signature(function).bind(*given, **{str(k.arg): None for k in call.keywords})
