"""A new effect is one new file."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from benchtop import LINEAR, axis, run

from phaselead.errors import BadInput
from phaselead.model import effects
from phaselead.model.axis import AdoptedEffect
from phaselead.model.stage_file import Stage, parse_stage, stage_text

FILE = """
from phaselead.model.effects.interface import Effect, Parameter, Picture, Place, number


def apply(signal, params):
    return signal.value + number(params, "lift_um")


EFFECT = Effect(
    name="levitation", title="Levitation", place=Place.ENVIRONMENT, equation="y = x + lift_um", source="none",
    parameters=(Parameter("lift_um", "um", 1.0, -5.0, 5.0, doc="how far"),), shows="it floats", reveals="idle",
    confused_with=("offset",), compensation="None.", apply=apply, picture=Picture("idle", {"lift_um": 1.0}),
)
"""


@pytest.fixture
def levitation(tmp_path, monkeypatch):
    (tmp_path / "levitation.py").write_text(FILE)
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    effects._all.cache_clear()
    yield
    effects._all.cache_clear()
    sys.modules.pop("phaselead.model.effects.levitation", None)


@pytest.mark.usefixtures("levitation")
def test_one_file_is_enough():
    assert "levitation" in effects.catalogue()
    floating = axis(LINEAR, AdoptedEffect(name="levitation", params={"lift_um": 2.0}))
    stage = Stage(name="s", axes={"x": floating})
    assert parse_stage(stage_text(stage)) == stage
    assert run(floating, np.zeros(3)) == pytest.approx([2.0] * 3)


def test_without_the_file_it_is_refused():
    with pytest.raises((BadInput, ValueError), match="is no known effect"):
        Stage(name="s", axes={"x": axis(LINEAR, AdoptedEffect(name="levitation"))})
