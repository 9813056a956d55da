"""Ties, the experiment that breaks them, and the limits it keeps to; the truth is a virtual stage in C."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from phaselead.gap.design import excitation_of, modes_crossed_Hz
from phaselead.gap.design.excitation import SHAPES, Excitation, about_limits, excitations, repeats, span_V
from phaselead.gap.design.next_experiment import chance_of_naming, passes, sensor_for
from phaselead.gap.findings import NextExperiment
from phaselead.gap.records import GapRun
from phaselead.gap.residual import ModelledRun, modelled_run, run_from_rest
from phaselead.gap.result import GapResult
from phaselead.gap.run import run_gap
from phaselead.identify.fitting import fit
from phaselead.model import Chain
from phaselead.model.axis import AdoptedEffect, AxisModel, Limits, TimeView
from phaselead.model.effects import Place, catalogue, effect
from phaselead.model.stage_file import Stage
from phaselead.record.recording import AxisRecord, Recording
from phaselead.sim.device import Plant
from phaselead.sim.plant import built_in, plant_parameters
from phaselead.waveforms.waveform import POINTS

RATE_HZ = 5000
RIVALS = {"delay", "sensor_lowpass", "amplifier_lowpass", "gain_change"}
NEEDED = np.log(2 * 0.99 / 0.01)
"""Log odds against each of two rivals for a probability of 0.99."""
WITHOUT = tuple(name for name in catalogue() if name not in RIVALS)
"""A small catalogue: what is tested here is the way from a tie to its end, not the search."""


def stage_with(*effects: AdoptedEffect) -> Stage:
    """The x axis of the built-in stage: its hysteresis, sensor noise and converters, and these effects."""
    x = built_in("xyz250").axes["x"].model_copy(update={"effects": effects})
    return Stage(name="truth", axes={"x": x})


def record(stage: Stage, u: np.ndarray, seed: int) -> Recording:
    codes = np.full((len(u), 3), 32768, np.uint16)
    codes[:, 0] = np.round(32768 + 3200 * u)
    x = Plant(plant_parameters(stage, seed)).run(codes)[:, 0] * (280 / 65536) - 10
    applied = (codes[:, 0].astype(float) - 32768) / 3200
    digest = hashlib.sha256(x.tobytes()).hexdigest()
    return Recording(np.arange(len(u)) / RATE_HZ, {"x": AxisRecord(applied, x)}, source=f"{seed}.csv", sha256=digest)


def sine(swing_V: float, f_Hz: float, seconds: float = 1.0) -> np.ndarray:
    return swing_V / 2 * (1 - np.cos(2 * np.pi * f_Hz * np.arange(round(seconds * RATE_HZ)) / RATE_HZ))


@cache
def reference() -> tuple[Stage, tuple[Recording, ...]]:
    """A model fitted to the stage as it was, and the records it was fitted on."""
    fast = Excitation("multisine", 2.0, (5.0, 1000.0), 4.0, 2.0).voltage(np.arange(2 * RATE_HZ) / RATE_HZ)
    waves = [sine(8, 2), sine(8, 5), sine(4, 5), sine(2, 10), sine(3, 40, 0.5), fast]
    records = tuple(record(stage_with(), u, 100 + i) for i, u in enumerate(waves))
    return fit(records)[0], records


def after(truth: AdoptedEffect, *more: Recording) -> GapResult:
    """What the workflow says of one sine at one level, and of ``more``."""
    model, references = reference()
    train = [record(stage_with(truth), sine(8, 5), 200), *more]
    return run_gap(model, train, [record(stage_with(truth), sine(8, 5), 300)], references, without=WITHOUT)


def test_the_proposed_experiment_breaks_the_tie_for_the_truth():
    name = "amplifier_lowpass"
    truth = AdoptedEffect(name=name, params={"tau_s": 4e-4})
    first = after(truth)
    assert any(name in tie for tie in first.ties)
    proposed = first.next_experiment
    assert proposed is not None
    assert proposed.needs_sensor is None
    assert proposed.separation > NEEDED
    assert proposed.chance > 0.95
    assert proposed.tells_apart in first.ties
    assert (proposed.axis, proposed.drives) == (None, "x")
    excitation = excitation_of(vars(proposed))
    t = np.arange(round(proposed.seconds * RATE_HZ)) / RATE_HZ
    then = after(truth, record(stage_with(truth), excitation.voltage(t), 400))
    assert then.ties == ()
    assert [e.name for e in then.effects] == [name]


@pytest.mark.parametrize("log_odds", [0.5, 4.0, 8.0, 20.0])
@pytest.mark.parametrize("ahead", [0.0, 2.0, 4.0])
def test_the_chance_of_two_is_how_often_the_truth_is_named(log_odds, ahead):
    """Each is true as often as the records so far say, and the record brings its odds with their scatter; it must speak
    for the name itself."""
    rng, draws = np.random.default_rng(0), 40_000
    log_posterior = np.array([ahead, 0.0])
    first = rng.random(draws) < 1 / (1 + np.exp(-ahead))
    brought = log_odds + np.sqrt(2 * log_odds) * rng.normal(size=draws)
    after = np.where(first, ahead, -ahead) + brought
    named = (1 / (1 + np.exp(-after)) >= 0.99) & (brought >= np.log(100))
    chance = chance_of_naming(np.full((2, 2), log_odds), log_posterior)
    assert chance == pytest.approx(named.mean(), abs=0.01)


@pytest.mark.parametrize("answers", [
    [[0.0, 0.0], [4.0, 0.0], [3.0, 2.0]],
    [[0.0, 0.0], [4.0, 0.0], [-4.0, 0.0]],
    [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 5.0]],
])  # fmt: skip
def test_the_chance_of_more_is_how_often_the_truth_passes_them_all(answers):
    """Answers are points, and what a record holds beside the true one is normal, of deviation 1."""
    at, rng, draws = np.array(answers), np.random.default_rng(0), 40_000
    n = len(at)
    log_posterior = np.log(np.linspace(1.0, 2.0, n))
    log_odds = np.sum((at[:, None] - at) ** 2, axis=2) / 2
    prior, named = np.exp(log_posterior) / np.exp(log_posterior).sum(), 0.0
    for true in range(n):
        record = at[true] + rng.normal(size=(draws, at.shape[1]))
        far = np.sum((record[:, None] - at) ** 2, axis=2) / 2
        brought = np.delete(far - far[:, [true]], true, axis=1)
        behind = np.delete(log_posterior - log_posterior[true], true)
        needed = np.maximum(behind + np.log((n - 1) * 99), np.log(100))
        named += prior[true] * np.mean((brought >= needed).all(axis=1))
    assert 0.05 < named < 0.95
    assert chance_of_naming(log_odds, log_posterior) == pytest.approx(named, abs=0.01)


def test_no_distances_make_all_rivals_easier_than_the_hardest():
    """Also those that no points can have, and where a rival is hardly told beside one that is."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        odds = rng.choice([0.0, 1e-12, 0.5, 5.0, 40.0], size=(4, 4))
        log_posterior = rng.normal(size=4)
        chance = chance_of_naming(odds, log_posterior)
        needed = np.maximum(log_posterior[:, None] - log_posterior + np.log(3 * 99), np.log(100))
        passing = np.where(np.eye(4, dtype=bool), 1.0, passes(odds, needed)).min(axis=0)
        assert 0 <= chance <= np.exp(log_posterior) @ passing / np.exp(log_posterior).sum() + 1e-9


def test_a_record_that_tells_nothing_settles_nothing_however_far_one_is_ahead():
    for ahead in (0.0, 4.0, 6.0, 20.0):
        assert chance_of_naming(np.zeros((2, 2)), np.array([ahead, 0.0])) < 0.01


def test_it_is_the_odds_of_the_true_one_against_its_rival_that_count():
    """[rival, true]: the second is sure to be named when it is true, the first never."""
    odds = np.array([[0.0, 50.0], [0.0, 0.0]])
    assert chance_of_naming(odds, np.log([0.3, 0.7])) == pytest.approx(0.7, abs=0.01)


def test_a_rival_that_cannot_be_told_takes_the_chance_of_those_it_is_confused_with():
    """Three of which two answer alike: the third is told, the two are not."""
    odds = np.array([[0.0, 1e-9, 50.0], [1e-9, 0.0, 50.0], [50.0, 50.0, 0.0]])
    assert chance_of_naming(odds, np.log([0.25, 0.25, 0.5])) == pytest.approx(0.5, abs=0.01)
    assert chance_of_naming(odds, np.log([0.49, 0.49, 0.02])) < 0.05
    assert passes(np.inf, 5.0) == 1.0


VIEW = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 8.0), rate_Hz=5000.0)


@pytest.mark.parametrize("slew", [50.0, 1000.0, 1e6])
@pytest.mark.parametrize("u_max_V", [5.0, 10.0])
def test_excitations_keep_to_voltage_and_slew(slew, u_max_V):
    axis = AxisModel(time=VIEW, limits=Limits(u_min_V=-1.0, u_max_V=u_max_V, slew_V_per_s=slew, ramp_V_per_s=10.0))
    found = excitations(axis, 1 / 5000)
    low, high = span_V(axis)
    assert (low, high) == (0.0, min(8.0, u_max_V))
    assert len(found) > (20 if slew >= 1000 else 8)
    assert {e.waveform for e in found} >= {"idle", "multisine", "steps", "sine"}
    for one in found:
        t = np.arange(round(one.seconds * 5000)) / 5000
        u = one.voltage(t)
        assert low - 1e-9 <= u.min()
        assert u.max() <= high + 1e-9
        if not one.idle:
            assert one.wave().steepest() <= slew
            assert abs(np.diff(u)).max() * 5000 <= slew * (1 + 1e-6)


@pytest.mark.parametrize(("u_range_V", "u_max_V"), [((12.0, 88.0), 10.0), ((12.0, 88.0), 12.0), ((-9.0, -3.0), 10.0)])
def test_a_device_that_may_put_out_none_of_the_fitted_voltages_is_offered_no_experiment(u_range_V, u_max_V):
    """A model of records of 12 to 88 V, whose user had not yet written the limits of the output: there was no result at
    all, after three minutes."""
    view = VIEW.model_copy(update={"u_range_V": u_range_V})
    axis = AxisModel(time=view, limits=Limits(u_min_V=-2.0, u_max_V=u_max_V))
    assert excitations(axis, 1 / 5000) == []
    (line,) = about_limits(axis)
    assert ", 0 % of the voltages that the model was fitted on" in line


@pytest.mark.parametrize(("u_max_V", "said"), [(10.0, " 10 % "), (50.0, " 52 % "), (96.0, ""), (120.0, "")])
def test_limits_that_leave_a_part_of_the_fitted_voltages_are_told(u_max_V, said):
    """Of a stage of 97 V with the built-in limits an experiment of 2 V was proposed, and nothing said why."""
    view = VIEW.model_copy(update={"u_range_V": (0.0, 97.0)})
    axis = AxisModel(time=view, limits=Limits(u_min_V=-2.0, u_max_V=u_max_V))
    assert [said in line for line in about_limits(axis)] == ([True] if said else [])


@pytest.mark.parametrize("name", SHAPES)
def test_what_is_predicted_is_what_the_device_plays(name):
    """1024 points of one period, joined by straight lines, over and over."""
    one = Excitation(name, 4.0, (5.0, 50.0), 3.0, 1.0)
    wave = one.wave()
    assert wave.points is not None
    assert wave.points.shape == (POINTS,)
    assert (wave.points.min(), wave.points.max()) == (0.0, 1.0)
    t = np.arange(5000) / 5000
    u = one.voltage(t)
    assert np.allclose(u[:1000], u[1000:2000], atol=1e-6)
    assert 1.0 - 1e-9 <= u.min() <= u.max() <= 5.0 + 1e-9
    assert np.ptp(wave.points) * wave.swing == pytest.approx(wave.swing)


def run_of(u: np.ndarray, role: str) -> ModelledRun:
    t = np.arange(len(u)) / RATE_HZ
    run = GapRun("x", role, t, u, 20 * u, None, 0, len(u), f"lab/{role}.csv", {}, {})  # type: ignore[arg-type]
    return modelled_run(AxisModel(time=VIEW), run)


def proposal(one: Excitation) -> NextExperiment:
    return NextExperiment(
        one.waveform, one.level_V, one.band_Hz, one.bias_V, one.seconds, 9.0, 0.9, None, one.source, one.points
    )


def test_what_is_predicted_is_a_stage_that_comes_from_rest():
    """Not from the memory with which the model would move least."""
    axis = one_wide_loop(reference()[0].axes["x"])
    run = run_of(sine(4, 5) + 3.0, "train").run
    unmeasured = replace(run, x_um=np.zeros_like(run.x_um))
    from_rest = Chain(axis, run.t_s, run.u_V).run()[run.rows]
    np.testing.assert_allclose(run_from_rest(axis, unmeasured).answer(), from_rest)
    assert not np.allclose(modelled_run(axis, unmeasured).answer(), from_rest)


def one_wide_loop(axis: AxisModel) -> AxisModel:
    """An axis of one wide loop."""
    assert axis.time is not None
    one = axis.time.model_copy(update={"play_r_V": (2.0,), "play_w_um_per_V": (5.0,)})
    return axis.model_copy(update={"time": one, "effects": ()})


def test_the_waveform_of_a_record_is_played_again():
    """A period of it, from its own points, which a gap.json carries; each waveform once."""
    ramp = np.interp(np.arange(3000), [0, 1000, 2999], [1.0, 4.0, 1.0])
    runs = [run_of(sine(4, 5), "reference"), run_of(sine(4, 5), "train"), run_of(ramp, "holdout")]
    found = repeats([*runs, run_of(np.zeros(2000), "reference")], AxisModel(time=VIEW))
    assert [(one.waveform, one.source) for one in found] == [("record", "reference.csv"), ("record", "holdout.csv")]
    assert found[0].seconds == 2.0
    for one, u in zip(found, (sine(4, 5), ramp), strict=True):
        proposed = proposal(one)
        again = excitation_of(json.loads(json.dumps(vars(proposed))))
        assert again == one
        assert again.voltage(np.arange(len(u) - 3) / RATE_HZ) == pytest.approx(u[:-3], abs=0.01)


def test_a_repeated_record_drives_every_mode_that_its_harmonics_reach():
    """A ramp of 0.3 Hz is no drive of 0.3 Hz alone, a sine is one of its own frequency."""
    ramp = np.interp(np.arange(3000), [0, 1000, 2999], [1.0, 4.0, 1.0])
    mode = AdoptedEffect(name="resonance", params={"c": 1.0, "f_Hz": 20.0, "zeta": 0.02})
    stage = Stage(name="s", axes={"x": AxisModel(time=VIEW, effects=(mode,))})
    crossed = []
    for u in (ramp, sine(4, 5)):
        (one,) = repeats([run_of(u, "train")], stage.axes["x"])
        made = proposal(one)
        crossed.append(modes_crossed_Hz(vars(made), stage, "x"))
    assert crossed == [[pytest.approx(20.0)], []]


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("amplifier_lowpass", "sensor_lowpass"), "voltage monitor"),
        (("sensor_nonlinearity", "sensor_lowpass"), "second position sensor"),
        (("resonance", "sensor_lowpass"), "interferometer"),
        (("thermal_drift", "mains_hum"), "temperature sensor"),
    ],
)
def test_a_sensor_between_the_places_where_the_members_act(names, words):
    assert words in sensor_for([effect(name) for name in names])
    assert min(effect(name).place for name in names) <= Place.ENVIRONMENT
