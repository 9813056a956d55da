"""The site: what Sphinx does not see. Links, anchors and notebooks fail `make manual`, which `make test` runs."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
MOST_BYTES = 600_000


def listed() -> list[str]:
    """The pages that the lists of the index hold, in their order."""
    trees = re.findall(r"```{toctree}\n(.*?)```", (DOCS / "index.md").read_text("utf-8"), re.DOTALL)
    return [line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")]


def test_every_page_is_listed_once():
    written = [path.relative_to(DOCS).with_suffix("").as_posix() for path in [*DOCS.glob("*.md"), *NOTEBOOKS]]
    assert sorted([*listed(), "index"]) == sorted(written)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_kept_without_what_they_print(path: Path):
    """The manual shows what the notebook prints today: it is run whenever the manual is built."""
    cells = json.loads(path.read_text("utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    guards = ["".join(cell["source"]) for cell in code if "remove-cell" in cell["metadata"].get("tags", [])]
    assert any("assert " in guard for guard in guards), "nothing checks what its words say"


def test_the_moving_picture_moves_and_is_small():
    path = DOCS / "images/tracking.gif"
    assert path.stat().st_size < MOST_BYTES
    with Image.open(path) as picture:
        assert picture.n_frames > 20
    assert "docs/images/tracking.gif" in (ROOT / "README.md").read_text("utf-8")


def targets() -> set[str]:
    return set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_make_is_asked_for_is_there(page: Path):
    text = page.read_text("utf-8")
    asked = re.findall(r"(?:`|^    |^\$ )make ([a-z][\w-]*)", text, re.MULTILINE)
    assert set(asked) <= targets(), page.name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_of_the_source_tree_that_a_page_names_are_there(page: Path):
    """Pages about adding something name files that are yet to be written."""
    if page.stem.startswith("adding-"):
        pytest.skip("tests/docs/test_adding.py does what it says")
    named = set(re.findall(r"`((?:docs|firmware|host|protocol|tests|benchmarks)/[\w./-]+)`", page.read_text("utf-8")))
    missing = [name for name in named if not (ROOT / name).exists()]
    assert missing == [], page.name


def test_a_users_install_brings_no_generator():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert not [need for need in project["dependencies"] if re.match("sphinx|furo|myst|jupyter|nb", need)]
