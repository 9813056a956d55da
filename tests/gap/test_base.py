"""What may be wrong with a base: reference records say how much, and none of it is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from phaselead.gap import base_operator
from phaselead.gap.axis import _proposal
from phaselead.gap.base_operator import find_memory, with_operator
from phaselead.gap.effect_search import select_effects
from phaselead.gap.posterior import Claim, each_fitted
from phaselead.gap.records import GapRun
from phaselead.gap.residual import left_um, modelled_run
from phaselead.gap.selection import Selection
from phaselead.model import Stage, predict, simulate
from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.model.effects import effect
from phaselead.record import AxisRecord, Recording
from phaselead.validation.trial import try_case
from trials import in_trials

TRUTH = str(Path(__file__).parent / "truth")
STEP_s = 5e-4


def test_a_mode_that_the_base_has_a_little_wrong_gains_nothing():
    outcome = try_case(TRUTH, "tuning/none/nothing/0/fast/78", follow_up=False)
    assert outcome["verdicts"] == ["none"]
    gaining = [row[1] for row in outcome["candidates"] if row[2] >= 0]
    assert not [names for names in gaining if {"resonance", "load_change"} & {*names.split(" + ")}]


@pytest.mark.parametrize("size", ["1/fast/2", *in_trials("0.2/fast/1")])
def test_a_mode_that_moved_from_a_base_without_references_is_no_other_mode(size):
    """A load moved it, or the base was wrong: that has no name, and a mode of its own does not get it."""
    outcome = try_case(TRUTH, f"tuning/unreferenced/load_change/{size}", follow_up=False)
    assert outcome["verdicts"] == ["unknown"]
    assert not outcome["named"]
    assert ["load_change", "provisional"] in outcome["adopted"]
    assert "load_change" not in {bound["name"] for bound in outcome["excluded"]}


@pytest.mark.trial
def test_a_load_that_moves_one_mode_of_two_is_no_mode_of_its_own():
    """Where it sits the smaller mode may stand still: both once moved alike, and what was left looked like a mode."""
    outcome = try_case(TRUTH, "tuning/unreferenced/load_change/1/fast/0", follow_up=False)
    sets = {row[1]: row[2] for row in outcome["candidates"]}
    assert max(sets, key=sets.__getitem__) == "load_change"
    assert outcome["adopted"] == [["load_change", "provisional"]]
    assert "load_change" not in outcome["untestable"]


@pytest.mark.parametrize("tied", [("load_change", "resonance"), ("resonance", "load_change")])
def test_a_tie_may_hold_what_cannot_be_told_from_a_base_that_was_wrong(tied):
    nameless = frozenset({"load_change"})
    tie, alone = claim(*tied), claim("load_change")
    selection = Selection(LINE, LINE, (), contest=None, found=(tie, alone), nameless=nameless)
    assert selection.claims == (tie,)
    assert selection.nameless_claims == (alone,)
    assert len(selection.messages) == 2
    assert all("load_change cannot be told from a model that was wrong" in said for said in selection.messages)
    assert _proposal(selection) is None  # no record alone can give the one a name


def claim(*tied):
    sets = tuple(((effect(name), {}),) for name in tied)
    return Claim(effect(tied[0]), 0.999, 20.0, 1.0, sets, tied)


def a_track():
    t = np.arange(2000) * STEP_s
    u = 4 - 4 * np.cos(2 * np.pi * 5 * t)
    view = TimeView(
        gain_um_per_V=5.0, delay_s=2e-4, play_r_V=(0.5, 1.5), play_w_um_per_V=(2.0, 1.0),
        rest_fraction=-1.0, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s, residual_um_rms=0.1,
    )  # fmt: skip
    mode = AdoptedEffect(name="resonance", params={"c": (0.9, 0.1), "f_Hz": (150.0, 420.0), "zeta": (0.02, 0.05)})
    run = GapRun("x", "train", t, u, np.zeros(2000), None, 0, 2000, "made.csv", {}, {})
    return modelled_run(AxisModel(time=view, effects=(mode,)), run)


def test_a_line_that_gets_plays_keeps_its_delay():
    made = a_track()
    line = TimeView(gain_um_per_V=8.0, delay_s=2e-4, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s)
    run = replace(made.run, x_um=made.answer())
    assert with_operator(AxisModel(time=line), [run]).time.delay_s == line.delay_s


@pytest.mark.parametrize("looped", [("train", "holdout"), ("reference", "train", "holdout")])
def test_loops_that_the_references_show_too_are_a_fault_of_the_base(looped):
    made = a_track()
    line = AxisModel(time=TimeView(gain_um_per_V=8.0, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s))
    rng, runs = np.random.default_rng(0), []
    for role in ("reference", "train", "holdout"):
        x = made.answer() if role in looped else 8.0 * made.run.u_V
        runs.append(replace(made.run, role=role, x_um=x + rng.normal(0, 0.01, len(x))))
    given, memory = find_memory(line, runs, [effect("hysteresis"), effect("gain_change")])
    if "reference" in looped:
        assert memory is None
        assert given is line
    else:
        assert memory.effect.name == "hysteresis"
        assert given.time.play_r_V


RINGING = AdoptedEffect(name="resonance", params={"c": (1.0,), "f_Hz": (150.0,), "zeta": (0.02,)})
LATE = AdoptedEffect(name="delay", params={"delay_s": 0.002})
LINE = AxisModel(time=TimeView(gain_um_per_V=8.0, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s))
TRIED = [effect(name) for name in ("hysteresis", "resonance", "delay", "creep", "softening")]


LEVELS = (("train", 1.0), ("train", 0.5), ("holdout", 0.8), ("holdout", 0.4))


def a_session(axis, seed=0, levels=LEVELS):
    """Runs of an axis, by default to train and held out: a slow wave and a fast one that sets modes ringing."""
    made, rng, runs = a_track(), np.random.default_rng(seed), []
    for role, level in levels:
        phase = rng.uniform(0, 6)
        quick = np.interp(np.arange(2000), np.arange(0, 2000, 9), rng.uniform(-1, 1, 223))
        u = 4 + level * (3 * np.sin(2 * np.pi * 5 * made.run.t_s + phase) + quick)
        driven = modelled_run(axis, replace(made.run, role=role, u_V=u))
        runs.append(replace(driven.run, x_um=driven.answer() + rng.normal(0, 0.01, 2000)))
    return runs


@pytest.mark.parametrize("missed_um_per_V", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("seed", [0, 1])
def test_what_no_reference_record_asked_of_the_base_is_no_effect(missed_um_per_V, seed):
    """The base lacks 0.6 to 2.5 % of its slope, as plays that the short ways of the reference records never move."""
    base = a_track().axis.model_copy(update={"effects": (RINGING,)})
    more = {"play_r_V": (0.5, 1.5, 2.5), "play_w_um_per_V": (2.0, 1.0, missed_um_per_V)}
    stage = base.model_copy(update={"time": base.time.model_copy(update=more)})
    short, long = [("reference", level) for level in (0.5, 0.4, 0.3)], [("train", 1.0), ("train", 0.9)]
    runs = a_session(stage, seed, [*short, *long, ("holdout", 0.95), ("holdout", 0.85)])
    selection = select_effects(base, runs, TRIED, [], frozen=True, on_progress=lambda share: None)
    assert not selection.claims
    assert not selection.something_unnamed


def rms_um(axis, effects, runs):
    """RMS that the axis with some effects leaves of the held-out runs, each about its mean."""
    axis = axis.model_copy(update={"effects": effects})
    errors = [modelled_run(axis, run).error() for run in runs if run.role == "holdout"]
    return float(np.sqrt(np.mean([np.var(error) for error in errors])))


@pytest.mark.parametrize("effects", [(RINGING,), (RINGING, LATE)])
def test_memory_is_found_beside_what_moves_more_and_fitted_beside_it(effects):
    runs = a_session(a_track().axis.model_copy(update={"effects": effects}))
    given, memory = find_memory(LINE, runs, TRIED)
    assert memory.effect.name == "hysteresis"
    assert all(one.name in memory.why.split(",")[0] for one in effects)
    assert not given.effects
    as_they_stand = with_operator(LINE, [run for run in runs if run.role == "train"])
    assert rms_um(given, effects, runs) < 0.6 * rms_um(as_they_stand, effects, runs)


def test_no_memory_is_given_where_more_moves_than_it_may_be_looked_for_beside(monkeypatch):
    runs = a_session(a_track().axis.model_copy(update={"effects": (RINGING, LATE)}))
    monkeypatch.setattr(base_operator, "MOST_BESIDE", 1)
    assert find_memory(LINE, runs, TRIED) == (LINE, None)


@pytest.mark.parametrize("seed", range(30))
def test_a_line_that_rings_has_no_loop(seed):
    """What a mode that is not quite right leaves looks like a loop of next to no width."""
    runs = a_session(LINE.model_copy(update={"effects": (RINGING,)}), seed)
    assert find_memory(LINE, runs, TRIED) == (LINE, None)


@pytest.mark.parametrize(("share", "opens"), [(1.0, True), (0.0, False), (-1.0, False)])
def test_a_loop_of_no_width_or_the_other_way_round_is_none(share, opens):
    runs = a_session(LINE)
    looped = a_session(a_track().axis.model_copy(update={"effects": ()}))
    mixed = [
        replace(one, x_um=one.x_um + share * (other.x_um - one.x_um)) for one, other in zip(runs, looped, strict=True)
    ]
    found = base_operator._loop([modelled_run(LINE, run) for run in mixed], effect("hysteresis"))
    assert (found is not None) == opens


def test_a_line_is_wrong_about_the_travel_that_its_loops_take():
    """The best straight line has taken up what plays lose at each reversal: the width of a loop does not hang on it."""
    made, rng = a_track(), np.random.default_rng(0)
    x = made.answer() + rng.normal(0, 0.01, len(made.run.t_s))
    slope = float(np.polyfit(made.run.u_V, x, 1)[0])
    line = AxisModel(time=TimeView(gain_um_per_V=slope, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s))
    runs = [replace(made.run, role=role, x_um=x) for role in ("train", "holdout")]
    _, memory = find_memory(line, runs, [effect("hysteresis")])
    opening_um = 2 * 0.5 * 2.0 + 2 * 1.5 * 1.0  # of the plays, at the middle of a full loop
    width, _, (low, high) = memory.params["width"]
    assert low < opening_um / (8 * slope) < high
    assert width == pytest.approx(opening_um / (8 * slope), rel=0.2)


@pytest.mark.parametrize("plays", [True, False])
@pytest.mark.parametrize("stepped", [True, False])
def test_a_record_begins_with_a_step_from_rest_or_where_it_had_stood(plays, stepped):
    """A stage parked at mid-range does not ring in its first row; one that was switched there does."""
    own = a_track().axis
    view = own.time if plays else TimeView(gain_um_per_V=8.0, delay_s=2e-4, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s)
    axis = own.model_copy(update={"time": view})
    t = np.arange(2000) * STEP_s
    u = 4 + 3 * np.sin(2 * np.pi * 5 * t)
    led = u if stepped else np.concatenate([np.linspace(0, 4, 4000), np.full(2000, 4.0), u])
    x = simulate(axis, np.arange(len(led)) * STEP_s, led)[-2000:]
    x = x + np.random.default_rng(0).normal(0, 0.01, 2000)
    made = modelled_run(axis, GapRun("x", "train", t, u, x, None, 0, 2000, "made.csv", {}, {}))
    assert (made.began is None) == stepped
    assert made.error().std() < 0.012


@pytest.mark.parametrize(
    "uneven", [{}, {"field_bend": 0.1}, {"field_bend": -0.15}, {"play_tilt": 0.4, "play_taper": 0.3}]
)
@pytest.mark.parametrize("turns", [(8.0,), (8.0, 0.0), (7.0, 0.5, 6.0)])
def test_what_a_model_leaves_is_told_from_where_a_record_began(turns, uneven):
    """After loops the plays stand elsewhere than after rest: the model is not to blame for that. Also where they stand
    in a field that is not the voltage, and where their weight depends on where they stand."""
    own = a_track().axis
    axis = own.model_copy(update={"time": own.time.model_copy(update=uneven)})
    t = np.arange(2000) * STEP_s
    u = 4 + 3 * np.sin(2 * np.pi * 5 * t)
    way = np.interp(np.arange(8000), np.linspace(0, 7000, len(turns) + 2), [0.0, *turns, 4.0])
    x = simulate(axis, np.arange(10_000) * STEP_s, np.concatenate([way, u]))[-2000:]
    x = x + np.random.default_rng(0).normal(0, 0.01, 2000)
    record = Recording(t, {"x": AxisRecord(u_V=u, x_um=x)})
    assert left_um(Stage(name="rig", axes={"x": axis}), [record]) == pytest.approx(0.01, rel=0.15)
    stepped = predict(Stage(name="rig", axes={"x": axis}), record).axes["x"].x_um
    assert np.std(x - stepped) > 0.1


def test_a_mode_that_a_line_lacks_rings_from_where_the_stage_was_parked():
    """Of the line alone a step and a stay are the same: a mode beside it would ring by the parked voltage."""
    line = AxisModel(time=TimeView(gain_um_per_V=8.0, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s))
    mode = AdoptedEffect(name="resonance", params={"f_Hz": 90.0, "zeta": 0.02})
    ringing = line.model_copy(update={"effects": (mode,)})
    t = np.arange(2000) * STEP_s
    u = 4 + np.where(t > 0.2, 1.0, 0.0)
    led = np.concatenate([np.linspace(0, 4, 1000), np.full(1000, 4.0), u])
    x = simulate(ringing, np.arange(4000) * STEP_s, led)[2000:]
    made = modelled_run(line, GapRun("x", "train", t, u, x, None, 0, 2000, "made.csv", {}, {}))
    best, params = each_fitted([made], [effect("resonance"), effect("delay")])[0]
    assert best.name == "resonance"
    left = made.error([(best, params)])
    assert left.std() < 0.02 * made.error().std()


def test_a_sensor_that_counts_backwards_leaves_the_plays_as_free_where_they_began():
    made = a_track()
    view = made.axis.time
    turned = view.model_copy(
        update={"gain_um_per_V": -view.gain_um_per_V, "play_w_um_per_V": tuple(-w for w in view.play_w_um_per_V)}
    )
    other_way = modelled_run(made.axis.model_copy(update={"time": turned}), replace(made.run, x_um=-made.run.x_um))
    assert made.nuisances.shape[1] > 1
    np.testing.assert_allclose(other_way.nuisances[:, 1:], -made.nuisances[:, 1:])


def test_an_axis_that_is_not_driven_while_it_is_learned_from_keeps_its_line():
    """With other axes driven one by one records are taken so: nothing is known of its memory, and nothing is wrong."""
    runs = []
    for one in a_session(LINE):
        still = np.full_like(one.u_V, one.u_V[0])
        runs.append(replace(one, u_V=still) if one.role == "train" else one)
    assert find_memory(LINE, runs, TRIED) == (LINE, None)
