"""A new effect is one new file: docs/adding-an-effect.md, word for word."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from benchtop import LINEAR, axis, run

from phaselead.errors import BadInput
from phaselead.model import compensation, effects
from phaselead.model.axis import AdoptedEffect
from phaselead.model.stage_file import Stage, parse_stage, stage_text
from phaselead.report import catalogue_page
from phaselead.sim.plant import plant_parameters

ROOT = Path(__file__).parents[3]
WITH_FOLDER = """
import sys
import pytest
from phaselead.model import effects

effects.__path__.append(sys.argv[1])
sys.exit(pytest.main(sys.argv[2:]))
"""
"""Run pytest with one more folder of effects."""


def files_of_the_page() -> dict[str, str]:
    """The text of each file that the page shows, by its path."""
    page = (ROOT / "docs" / "adding-an-effect.md").read_text("utf-8")
    return dict(re.findall(r"^`(\S+\.py)`:\n\n```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE))


EFFECT, TEST = files_of_the_page().items()


@pytest.fixture
def relaxation(tmp_path, monkeypatch):
    (tmp_path / Path(EFFECT[0]).name).write_text(EFFECT[1])
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    effects._all.cache_clear()
    yield AdoptedEffect(name="relaxation", params={"late": 0.2, "tau_s": 0.01})
    effects._all.cache_clear()
    sys.modules.pop("phaselead.model.effects.relaxation", None)


def test_the_files_belong_where_the_page_says():
    assert (ROOT / EFFECT[0]).parent == Path(effects.__file__).parent
    assert (ROOT / TEST[0]).parent == Path(__file__).parent


def test_one_file_is_enough(relaxation):
    assert "relaxation" in effects.catalogue()
    model = axis(LINEAR, relaxation)
    stage = Stage(name="s", axes={"x": model})
    assert parse_stage(stage_text(stage)) == stage
    late = run(model, np.ones(2000))
    assert late[0] == pytest.approx(8.0, abs=0.2)
    assert late[-1] == pytest.approx(10.0)
    assert plant_parameters(stage).linked
    f_Hz = np.array([1.0, 5.0, 16.0, 50.0])
    inverse = 1 / (0.8 + 0.2 / (1 + 2j * np.pi * f_Hz * 0.01))
    assert compensation(model).shape[0].response(f_Hz) == pytest.approx(inverse, rel=0.01)
    assert effects.effect("relaxation").compensated
    assert "## Relaxation" in catalogue_page._markdown(effects.catalogue())


def test_its_test_and_the_laws_of_all_effects_hold(tmp_path):
    """In a process of its own, where the folder is there before any test is collected."""
    (tmp_path / "effects").mkdir()
    (tmp_path / "effects" / Path(EFFECT[0]).name).write_text(EFFECT[1])
    (tmp_path / Path(TEST[0]).name).write_text(TEST[1])
    tests = [
        tmp_path / Path(TEST[0]).name,
        ROOT / "tests" / "model" / "effects" / "test_laws.py",
        ROOT / "tests" / "sim" / "test_linked.py",
    ]
    options = ["-q", "-k", "relaxation", "-p", "no:cacheprovider", "-c", ROOT / "pyproject.toml", "--rootdir", ROOT]
    words = [sys.executable, "-c", WITH_FOLDER, tmp_path / "effects", *options, *tests]
    ran = subprocess.run([str(word) for word in words], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    passed = re.search(r"(\d+) passed", ran.stdout)
    assert passed is not None
    assert int(passed[1]) >= 15


def test_without_the_file_it_is_refused():
    with pytest.raises((BadInput, ValueError), match="is no known effect"):
        Stage(name="s", axes={"x": axis(LINEAR, AdoptedEffect(name="relaxation"))})
