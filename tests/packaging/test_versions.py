"""One version everywhere, and a lock file that fits the ranges."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import phaselead

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]


def test_the_version_is_the_same_everywhere():
    assert PROJECT["version"] == phaselead.__version__
    assert f"\nversion: {phaselead.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"Version {phaselead.__version__} " in (ROOT / "CHANGELOG.md").read_text()


@pytest.mark.parametrize(
    ("lock", "wanted"),
    [
        ("requirements.lock", PROJECT["dependencies"] + EXTRAS["test"]),
        ("requirements-browser.lock", PROJECT["dependencies"] + EXTRAS["test"] + EXTRAS["browser"]),
        ("requirements-docs.lock", PROJECT["dependencies"] + EXTRAS["test"] + EXTRAS["docs"]),
        ("requirements-board.lock", PROJECT["dependencies"] + EXTRAS["board"]),
        ("requirements-fuzz.lock", PROJECT["dependencies"] + EXTRAS["fuzz"]),
    ],
)
def test_the_lock_file_holds_a_fitting_version_of_everything_asked_for(lock, wanted):
    pins = [Requirement(line) for line in re.findall(r"^(\S+==[^\\]+) \\$", (ROOT / lock).read_text(), re.M)]
    for need in map(Requirement, wanted):
        versions = [spec.version for pin in pins if canonicalize_name(pin.name) == need.name for spec in pin.specifier]
        assert versions, f"{need.name} is not in {lock}; run make lock"
        assert all(need.specifier.contains(version) for version in versions), f"{need}: {versions}; run make lock"


@pytest.mark.parametrize("lock", sorted(path.name for path in ROOT.glob("requirements*.lock")))
def test_the_lock_file_names_no_index_and_no_file(lock):
    text = (ROOT / lock).read_text()
    assert "--hash=sha256:" in text
    assert not re.search(r"://|--(extra-)?index|--find-links|^-e", text, re.M)
