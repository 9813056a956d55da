"""Effects in front of shared modes that the records cannot tell apart are a tie, and those that they can are not."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "identify"))

from shared_structure import PERIOD, Structure

from phaselead.gap.run import run_gap
from phaselead.identify.fitting import fit
from phaselead.model import catalogue
from phaselead.model.operator import weighed_plays
from phaselead.record.recording import AxisRecord

WIDTH_V = 0.3
IN_FRONT = ("dead_band", "crossover_distortion")


def experiments(structure: Structure, count: int, level_V: float, name: str):
    """Records of a structure whose actuators follow with a dead band."""
    found = []
    for i in range(count):
        u = np.tile(structure.multisine(level_V), (2, 1))
        moved = np.stack([weighed_plays(c, [WIDTH_V / 2], [1.0], [float(c[0])]) for c in u.T], axis=1)
        seen = structure.record(moved, f"{name}{i}", warm_rows=PERIOD)
        axes = {a: AxisRecord(u[:, j].copy(), x.x_um) for j, (a, x) in enumerate(seen.axes.items())}
        found.append(replace(seen, axes=axes))
    return found


@pytest.fixture(scope="module")
def records():
    structure = Structure(7)
    train = [r for v in (1.0, 3.0) for r in experiments(structure, 3, v, f"train{v:g}-")]
    return train, [r for v in (1.0, 3.0) for r in experiments(structure, 2, v, f"held{v:g}-")]


def searched(records, monkeypatch, without: tuple[str, ...]):
    """The search, where a dead band is fitted with the modes in place of ``crossover_distortion``, its rival."""

    def effects(left_out=()):
        found = catalogue(left_out)
        fitted = {name: replace(found[name], fitted_with_modes=name == "dead_band") for name in IN_FRONT}
        return {**found, **fitted}

    monkeypatch.setattr(importlib.import_module("phaselead.gap.run"), "catalogue", effects)
    return run_gap(fit(records[0], base="linear")[0], *records, without=without)


def adopted(result) -> set[tuple[str, str]]:
    return {(one.name, one.status) for one in result.adopted if one.name in ("dead_band", "backlash")}


@pytest.mark.trial
def test_two_equations_that_predict_alike_are_a_tie(records, monkeypatch):
    """A dead band in volts and one in micrometres are one thing where nothing lies between them."""
    result = searched(records, monkeypatch, ("hysteresis", "rate_dependence", "asymmetric_hysteresis"))
    (tie,) = result.ties
    assert set(tie) == {"dead_band", "backlash"}
    assert "tie" in result.verdicts
    assert not {e.name for e in result.effects} & set(tie)
    assert adopted(result) == {(tie[0], "provisional")}
    assert not {b.name for b in result.excluded} & set(tie)
    assert result.gap.after < 0.01 * result.gap.before
    assert "these records cannot tell apart: " + ", ".join(tie) in str(result)
    # Nothing tells what is the same in every prediction.
    assert result.next_experiment.separation < 1
    assert result.next_experiment.tells_apart == tie
    assert result.next_experiment.needs_sensor == "a voltage monitor at the amplifier's output"


def test_what_the_records_tell_apart_is_named(records, monkeypatch):
    """Without the equation that says the same, the dead band's other rivals predict the records worse."""
    without = ("hysteresis", "rate_dependence", "asymmetric_hysteresis", "backlash")
    result = searched(records, monkeypatch, without)
    assert not result.ties
    assert adopted(result) == {("dead_band", "named")}
