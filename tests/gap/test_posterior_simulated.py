"""What is simulated together, kept and used again is what each part would be by itself."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from phaselead.gap.findings import GapSize
from phaselead.gap.goodness_of_fit import FinalFit
from phaselead.gap.history import before_record
from phaselead.gap.parameters import fresh_columns, parameters_of
from phaselead.gap.posterior import Likelihood, likelihood_of
from phaselead.gap.posterior.blocks import REMEMBERED, BlockedRun
from phaselead.gap.posterior.starts import Starts
from phaselead.gap.records import GapRun
from phaselead.gap.residual import modelled_run
from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.chain import Chain
from phaselead.model.effects import effect
from phaselead.model.effects.interface import STOOD_OFF
from phaselead.model.operator import plays_after

STEP_S, ROWS = 1e-3, 700
LOOPS = AxisModel(
    time=TimeView(
        gain_um_per_V=10.0, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_S,
        play_r_V=(0.3, 1.0), play_w_um_per_V=(0.5, 1.0), delay_s=4e-4,
    )
)  # fmt: skip
CREEP, GAIN, MODE = (effect(name) for name in ("creep", "gain_change", "resonance"))
SETS = {
    "nothing": (),
    "one effect": ((GAIN, {"gain": 0.1}),),
    "a slow one": ((CREEP, {"gamma": 0.05, "tau_first_s": 0.01, "tau_last_s": 30.0}),),
    "several": (
        (MODE, {"f_Hz": 90.0, "zeta": 0.05, "c": 1.0}),
        (CREEP, {"gamma": 0.05, "tau_first_s": 0.01, "tau_last_s": 30.0}),
        (GAIN, {"gain": 0.1}),
    ),
}


def sized(entries):
    """The same with those parameters alone that the catalogue has."""
    return tuple((e, {p.name: params.get(p.name, p.typical) for p in e.parameters}) for e, params in entries)


def run_of(role, seed):
    rng, t = np.random.default_rng(seed), np.arange(ROWS) * STEP_S
    u = 4 + 1.5 * np.sin(2 * np.pi * (3 + seed) * t) + 0.5 * np.sin(2 * np.pi * 70 * t)
    x = Chain(LOOPS, t, u).run(sized(SETS["several"])) + 0.01 * rng.normal(size=ROWS)
    return GapRun("x", role, t, u, x, None, 0, ROWS, f"{seed}.csv", {}, {})


@cache
def learned() -> Likelihood:
    roles = ("reference", "train", "train", "holdout")
    return likelihood_of([modelled_run(LOOPS, run_of(role, seed)) for seed, role in enumerate(roles)])


def forgetful(run: BlockedRun) -> BlockedRun:
    """The same run, of which nothing is kept."""
    return BlockedRun(run.modelled, run.usual_um)


@pytest.mark.parametrize("entries", SETS.values(), ids=SETS)
def test_a_set_is_simulated_together_as_each_part_alone(entries):
    entries, run = sized(entries), forgetful(learned().runs[1])
    found = run.simulated(entries)
    free = parameters_of(entries)
    fresh = run.coefficients(fresh_columns(run.modelled.run, run.modelled.answer, entries))
    assert found.tangents == len(free)
    scale = abs(fresh).max()
    np.testing.assert_allclose(found.columns[:, : len(free)], fresh[:, :-1], atol=1e-9 * scale)
    np.testing.assert_allclose(found.columns[:, -1], fresh[:, -1], atol=1e-9 * scale)
    before = before_record(run.modelled, entries)
    assert [part.shape[1] > 0 for part in before] == [e.before_record is not None for e, _ in entries]
    widths = [part.shape[1] for part in before]
    assert found.of_effects == tuple(np.repeat(np.arange(len(entries)), widths))
    for i, part in enumerate(before):
        mine = found.before[:, np.equal(found.of_effects, i)]
        np.testing.assert_allclose(mine, run.coefficients(part), atol=1e-9)
        assert mine.any() or not part.shape[1]
    assert found.power.shape == (len(entries), len(run.sizes))
    for i, power in enumerate(found.power):
        rest = [*entries[:i], *entries[i + 1 :]]
        alone = run.power(run.modelled.answer(entries) - run.modelled.answer(rest))
        np.testing.assert_allclose(power, alone, rtol=1e-9)


def test_what_is_kept_is_what_would_be_simulated_again():
    run = forgetful(learned().runs[1])
    first, other = sized(SETS["one effect"]), sized(SETS["a slow one"])
    kept = run.simulated(first)
    run.simulated(other)
    assert run.simulated([(e, dict(params)) for e, params in first]) is kept
    (gain, params) = first[0]
    moved = run.simulated([(gain, {**params, "gain": 0.2})])
    assert not np.array_equal(moved.columns, kept.columns)
    np.testing.assert_array_equal(kept.columns, forgetful(run).simulated(first).columns)


def test_the_columns_that_are_kept_are_limited_and_the_last_set_is_always_among_them():
    run, (gain, params) = forgetful(learned().runs[1]), sized(SETS["one effect"])[0]
    first = run.simulated([(gain, params)])
    for size in np.linspace(0.1, 0.2, 2 * REMEMBERED):
        last = run.simulated([(gain, {"gain": float(size)})])
        assert sum(one.columns.shape[1] for one in run._known.values()) <= REMEMBERED
        assert run.simulated([(gain, {"gain": float(size)})]) is last
    assert run.simulated([(gain, params)]) is not first
    several = sized(SETS["several"]) * 12
    wide = run.simulated(several)
    assert wide.columns.shape[1] > REMEMBERED
    assert run.simulated(several) is wide


@pytest.mark.parametrize("entries", SETS.values(), ids=SETS)
def test_where_nothing_moved_a_set_without_tangents_is_as_likely_as_with_them(entries):
    entries, shares = sized(entries), [0.05, 0.3]
    among = learned().knowing([sized(SETS["one effect"])[0]])
    terms = among.terms(entries)
    near = among._near(terms, entries)
    assert near.moments.tangents == 0
    np.testing.assert_allclose(among.log_joint(near, shares), among.log_joint(terms, shares), rtol=1e-12)


def test_shapes_are_simulated_once_for_all_likelihoods_of_the_same_runs():
    effects = [GAIN, CREEP, effect("delay")]
    plain, set_of_one = learned(), sized(SETS["one effect"])
    knowing = plain.knowing(set_of_one)
    starts = Starts(plain, effects)
    assert starts.sizes(plain.fit(set_of_one))
    again, anew = (one.sizes(knowing.fit(set_of_one)) for one in (starts.of(knowing), Starts(knowing, effects)))
    assert [(a.group.shapes, a.amount, a.deviation) for a in again] == [
        (b.group.shapes, b.amount, b.deviation) for b in anew
    ]
    assert starts.of(knowing).shapes is starts.shapes
    assert starts.likelihood is plain


def test_another_base_likelihood_keeps_what_its_runs_have_simulated():
    """Likelihoods that know of more share the runs, and with them what is kept."""
    plain = learned()
    for other in (plain.knowing(sized(SETS["one effect"])), plain.without_held_out(), replace(plain)):
        assert set(map(id, other.runs)) <= set(map(id, plain.runs))


@pytest.mark.parametrize("began", [None, (4.0, 1.0)])
def test_a_voltage_that_had_stood_off_shifts_plays_as_well(began):
    """They came about there: all that a steady one does is an offset. It was taken for a bend of the sensor."""
    plays_V = None if began is None else plays_after(LOOPS.time, *began)
    run = run_of("train", 1)
    model = replace(modelled_run(LOOPS, run), chain=Chain(LOOPS, run.t_s, run.u_V, start=plays_V))
    (before,) = before_record(model, [(effect("charge_leakage"), {"rate_per_s": 1e-9})])
    low, high = LOOPS.time.u_range_V
    moved_um = np.full((ROWS, 1), STOOD_OFF * (high - low) * (10.0 + 0.5 + 1.0))  # the gain and both plays
    np.testing.assert_allclose(before, moved_um)


def test_what_had_gone_on_before_is_no_gap_that_a_voltage_predicts():
    """As far as a record tells, each a size of its own."""
    rng, runs = np.random.default_rng(1), [modelled_run(LOOPS, run_of("holdout", seed)) for seed in (1, 2)]
    entries = sized(SETS["a slow one"])
    noise_um = [0.01 * rng.normal(size=ROWS) for _ in runs]
    measured = []
    for run, amount, noise in zip(runs, (1.0, -0.5), noise_um, strict=True):
        (before,) = before_record(run, entries)
        x_um = run.answer(entries) + amount * before.sum(axis=1) + noise
        measured.append(replace(run, run=replace(run.run, x_um=x_um)))
    final = FinalFit(LOOPS, entries, tuple(measured), tuple(measured), GapSize(0.0, 0.0, 0.0))
    assert all(np.std(left.error_um) > 0.1 for left in final.residuals("holdout"))
    clean = final.without_history()
    for left, noise in zip(clean.holdout, noise_um, strict=True):
        assert np.std(left.error_um) < 1.1 * np.std(noise)
    assert clean.gap.after < 0.011
    unmoved_um2 = [np.var(run.answer(entries) - run.answer()) + 0.01**2 for run in runs]
    assert clean.gap.before == pytest.approx(np.sqrt(np.mean(unmoved_um2)), rel=0.02)


@pytest.mark.parametrize("name", ["a slow one", "several"])
def test_where_nothing_had_gone_on_before_the_gap_stays(name):
    """What a base leaves looks like it: fitted to that, it took half of the gap before away."""
    rng, runs = np.random.default_rng(2), [modelled_run(LOOPS, run_of("holdout", seed)) for seed in (1, 2)]
    entries = sized(SETS[name])
    measured = [
        replace(run, run=replace(run.run, x_um=run.answer(entries) + 0.01 * rng.normal(size=ROWS))) for run in runs
    ]
    final = FinalFit(LOOPS, entries, tuple(measured), tuple(measured), GapSize(0.0, 0.0, 0.0))
    left = np.concatenate([one.error_um for one in final.residuals_before()])
    assert final.without_history().gap.before == pytest.approx(np.sqrt(np.mean(left**2)), rel=0.01)
