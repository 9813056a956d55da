"""Axes that move together against a frozen model: what it has stays, number for number; what is new is beyond it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "identify"))

from shared_structure import Structure

from phaselead.errors import BadInput
from phaselead.gap.records import axis_runs
from phaselead.gap.run import run_gap
from phaselead.gap.several_axes.base_modes import modes_as_they_are
from phaselead.gap.several_axes.joint_records import joint_records
from phaselead.identify.fitting import fit
from phaselead.model.prediction import predict

SOFT = 0.006


def records(levels: tuple[float, ...], softening: float = SOFT, draw: int = 7):
    """Records to learn from and to judge on; those of another ``draw`` are of the same structure."""
    structure = Structure(7, softening=softening)
    structure.rng = np.random.default_rng(draw)
    train = [r for v in levels for r in structure.experiments(3, v, f"train{v:g}-")]
    return train, [r for v in levels for r in structure.experiments(2, v, f"held{v:g}-")]


@pytest.fixture(scope="module")
def lines():
    train, held = records((1.0,))
    return fit(train, base="linear")[0], train, held


@pytest.fixture(scope="module")
def modes(lines):
    return run_gap(*lines).stage


@pytest.fixture(scope="module")
def both():
    return records((1.0, 3.0))


@pytest.fixture(scope="module")
def frozen(modes, both):
    return run_gap(modes, *both, frozen=True)


def untouched(base, after) -> bool:
    """Whether a stage has every number of another one."""
    return all(
        after.axes[a].time == model.time and after.axes[a].effects[: len(model.effects)] == model.effects
        for a, model in base.axes.items()
    )


def test_a_frozen_model_keeps_every_number_and_softening_comes_beside(modes, frozen):
    assert untouched(modes, frozen.stage)
    assert {e.name for e in frozen.effects} == {"softening"}
    assert frozen.gap.after < 0.5 * frozen.gap.before
    assert any("kept as the model has them" in message for message in frozen.messages)


@pytest.mark.trial
def test_a_refit_moves_the_modes(modes, both):
    found = run_gap(modes, *both, frozen=False)
    assert not untouched(modes, found.stage)
    assert found.gap.after < 0.1 * found.gap.before


def test_frozen_softening_stays_too(frozen):
    """More softening than the model has is left as a gap, under no name."""
    train, held = records((1.0, 3.0), softening=2 * SOFT, draw=8)
    found = run_gap(frozen.stage, train, held, frozen=True)
    assert untouched(frozen.stage, found.stage)
    assert "softening" not in {e.name for e in found.effects}
    assert "unknown" in found.verdicts


def test_held_modes_predict_as_the_stage_file_does(frozen, both):
    """The fit of modes starts from the same numbers that the next command reads."""
    stage = frozen.stage
    runs = axis_runs(stage, *both, ())
    train = [r for r in joint_records({a: stage.axes[a] for a in runs}, runs) if r.role == "train"]
    base = modes_as_they_are(stage, train)
    for record, recording in zip(train, both[0], strict=True):
        predicted = predict(stage, recording)
        answer = base.answer(record)
        for i, a in enumerate(record.axes):
            moved = predicted.axes[a].x_um
            assert np.ptp(answer[1:, i] - moved) < 1e-9 * np.ptp(moved)


def test_reference_records_freeze_a_model_with_modes(modes, both):
    reference = records((1.0,), draw=9)[0]
    assert untouched(modes, run_gap(modes, *both, reference).stage)


def test_a_model_without_modes_has_nothing_to_freeze(lines):
    with pytest.raises(BadInput, match=r"no modes that its axes share.*--refit"):
        run_gap(*lines, frozen=True)
