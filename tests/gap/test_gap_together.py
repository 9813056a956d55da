"""Records in which all axes of a stage move at once: what the axes share is named, and nothing else."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "identify"))

from click.testing import CliRunner
from shared_structure import F_HZ, PERIOD, Structure

from phaselead.cli import main
from phaselead.errors import BadInput
from phaselead.gap.run import run_gap
from phaselead.gap.several_axes.base_modes import has_common_modes
from phaselead.gap.several_axes.common_modes import _best_at_rest, _exponents
from phaselead.identify.fitting import fit
from phaselead.model.axis import AdoptedEffect
from phaselead.model.prediction import predict
from phaselead.model.stage_file import Stage, parse_stage, save_stage, stage_text
from phaselead.record.recording import AxisRecord

NOISE_um = 9.0
"""That hides with what power of the level the structure softens."""


def searched(softening: float, levels: tuple[float, ...], start: Stage | None = None):
    structure = Structure(7, softening=softening)
    train = [r for v in levels for r in structure.experiments(3, v, f"train{v:g}-")]
    held = [r for v in levels for r in structure.experiments(2, v, f"held{v:g}-")]
    stage = start or fit(train, base="linear")[0]
    return stage, train, held, run_gap(stage, train, held)


@pytest.fixture(scope="module")
def one_level():
    return searched(0.0, (1.0,))


@pytest.fixture(scope="module")
def two_levels(one_level):
    return searched(0.006, (1.0, 3.0), one_level[3].stage)


def names(result) -> set[str]:
    return {e.name for e in result.effects}


def test_modes_and_coupling_are_named_on_every_axis(one_level):
    stage, _, _, result = one_level
    assert {(e.name, e.axis) for e in result.effects} == {
        (name, axis) for name in ("resonance", "cross_coupling") for axis in "xyz"
    }
    assert result.gap.after < 0.02 * result.gap.before
    assert "softening" in result.untestable
    assert has_common_modes(result.stage)
    assert not has_common_modes(stage)
    found = next(e for e in result.effects if e.name == "resonance" and e.axis == "x").params["f_Hz"][0]
    for f in F_HZ:
        assert np.min(np.abs(np.array(found) - f)) < 0.005 * f


@pytest.mark.parametrize(("share", "verdicts"), [(0.1, ["named"]), (0.4, ["named", "unknown"])])
def test_what_equations_cannot_miss_is_unknown_beside_the_names(one_level, share, verdicts):
    """The records are too short to show what does not repeat, so that no floor tells how much is left."""
    stage, train, held, found = one_level
    bow_um, rows = share * found.gap.before, slice(2 * PERIOD - 100)

    def bent(record):
        q = record.axes["x"].u_V ** 2 / np.mean(record.axes["x"].u_V ** 2)
        added = {"x": bow_um * (q - 1) / np.std(q)}
        axes = {a: AxisRecord(r.u_V[rows], (r.x_um + added.get(a, 0.0))[rows]) for a, r in record.axes.items()}
        return replace(record, t_s=record.t_s[rows], axes=axes, scored=slice(PERIOD, rows.stop))

    result = run_gap(stage, [bent(r) for r in train], [bent(r) for r in held])
    assert list(result.verdicts) == verdicts
    assert result.unexplained.something_missing
    assert result.unexplained.of_equations == ("unknown" not in verdicts)


def test_the_stage_file_holds_what_was_found(one_level):
    _, _, held, result = one_level
    again = parse_stage(stage_text(result.stage))
    assert again == result.stage
    squares = []
    for record in held:
        predicted = predict(again, record)
        for axis, seen in record.axes.items():
            error = (seen.x_um - predicted.axes[axis].x_um)[record.scored]
            squares.append((error - error.mean()) ** 2)
    assert np.sqrt(np.mean(squares)) == pytest.approx(result.gap.after, rel=1e-6)


def test_a_level_that_moves_the_modes_is_softening(two_levels):
    _, _, _, result = two_levels
    assert names(result) == {"softening"}
    assert result.gap.after < 0.1 * result.gap.before
    drop = sum(np.array(e.params["f_drop"][0]) for e in result.effects)
    assert np.median(drop) > 0
    assert any("3 V rms" in message for message in result.messages)


def test_two_levels_without_softening_name_none(one_level):
    structure = Structure(7)
    train = [r for v in (1.0, 3.0) for r in structure.experiments(3, v, f"t{v:g}-")]
    held = [r for v in (1.0, 3.0) for r in structure.experiments(2, v, f"h{v:g}-")]
    result = run_gap(one_level[3].stage, train, held)
    assert names(result) == set()
    assert result.verdicts == ("none",)


def test_lists_that_do_not_belong_together_are_refused(one_level):
    stage, record = one_level[3].stage, one_level[2][0]
    axis = stage.axes["x"]
    short = [
        AdoptedEffect(name=e.name, params={k: v[:-1] if k == "velocity" else v for k, v in e.params.items()})
        for e in axis.effects
    ]
    broken = stage.model_copy(update={"axes": {**stage.axes, "x": axis.model_copy(update={"effects": tuple(short)})}})
    with pytest.raises(BadInput, match="modes but"):
        predict(broken, record)


def test_the_simulator_says_that_it_has_no_shared_modes(one_level, tmp_path):
    save_stage(tmp_path / "modes.toml", one_level[3].stage)
    said = CliRunner().invoke(main, ["status", "--port", f"sim://{tmp_path / 'modes.toml'}"])
    assert said.exit_code == 2
    assert "modes that the axes share" in said.stderr


def test_an_undetermined_power_of_the_level_has_a_record_that_would_tell(tmp_path):
    """Two levels fix a line whatever the power, as far as noise shows: a level between them would tell. gap next
    cannot play it."""
    structure = Structure(7, softening=0.006, noise_um=NOISE_um)
    train, held = ([r for v in (1.0, 3.0) for r in structure.experiments(n, v, f"{n}-{v:g}-")] for n in (3, 2))
    result = run_gap(fit(train, base="linear")[0], train, held)
    exponent = next(e for e in result.effects if e.name == "softening").params["exponent"]
    proposed = result.as_json()["next_experiment"]
    assert exponent[2] == (0.5, 2.0)
    assert not result.ties
    assert (proposed["waveform"], proposed["axis"], proposed["needs_sensor"]) == ("multisine", "x,y,z", None)
    assert proposed["drives"] == "x,y,z"
    played = sorted(float(np.max([np.ptp(a.u_V) for a in r.axes.values()])) for r in train)
    assert played[2] < 0.8 * proposed["level"]
    assert proposed["level"] < 0.8 * played[3]
    assert proposed["band"] == pytest.approx([2000 / 1024, 900], rel=0.01)
    assert proposed["separation"] > 20
    result.save_json(tmp_path / "gap.json")
    said = CliRunner().invoke(main, ["gap", "next", str(tmp_path / "gap.json"), "-o", str(tmp_path / "more.h5")])
    assert said.exit_code == 2
    assert "drives x,y,z at once" in said.stderr
    assert said.stderr.count("\n") == 1
    assert proposed["tells_apart"] == []
    assert "next, to tell which power of the level softening grows by: " in str(result)
    assert "on x, y, z at once" in str(result)


@pytest.mark.parametrize(("levels_V", "told"), [((1.0, 1.05, 3.0), False), ((1.0, 2.0, 3.0), True)])
def test_two_levels_leave_the_power_open_whatever_a_fit_of_each_leaves(levels_V, told):
    """A fit under one power may end lower than under another; of two levels that is what the model misses, no power."""
    records = [SimpleNamespace(level_V=level_V) for level_V in levels_V]
    assert (_exponents({0.5: 2.0, 1.0: 1.5, 2.0: 1.0}, records) != (0.5, 2.0)) == told


@pytest.mark.trial
def test_a_determined_power_asks_for_no_record(one_level):
    structure = Structure(7, softening=0.006)
    levels = (1.0, 2.0, 3.0)
    train, held = ([r for v in levels for r in structure.experiments(n, v, f"{n}-{v:g}-")] for n in (3, 2))
    assert run_gap(one_level[3].stage, train, held).next_experiment is None


def test_a_bound_says_of_which_axis_it_is(one_level):
    result = one_level[3]
    bounds = result.as_json()["excluded"]
    assert list(bounds[0]) == ["name", "axis", "upper_95", "unit"]
    assert {b["axis"] for b in bounds} == {"x", "y", "z"}
    assert len({(b["name"], b["axis"]) for b in bounds}) == len(bounds)
    assert all(f"{b['name']} ({b['axis']}) < " in " ".join(str(result).split()) for b in bounds)


def test_a_power_whose_modes_grow_at_rest_is_not_chosen():
    """Between two levels it may fit best, but a model is asked at others too."""

    def fit(*zeta: float):
        return SimpleNamespace(model=SimpleNamespace(zeta=np.array(zeta)))

    powers = {0.5: fit(0.02, -0.001), 1.0: fit(0.02, 0.01), 2.0: fit(0.02, 0.02)}
    assert _best_at_rest({0.5: 1.0, 1.0: 2.0, 2.0: 3.0}, powers) == 1.0
    assert _best_at_rest({0.5: 1.0, 1.0: 3.0, 2.0: 2.0}, powers) == 2.0
    powers[0.5] = fit(0.02, 0.001)
    assert _best_at_rest({0.5: 1.0, 1.0: 2.0, 2.0: 3.0}, powers) == 0.5
