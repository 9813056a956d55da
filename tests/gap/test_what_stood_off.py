"""What a leak had done before a record began is a voltage: it passes plays and bends, and much of it does not do what a
little does so many times over."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig import Rig
from scipy.signal import lfilter
from test_gap_laws import waves

from phaselead.gap.effect_search import _that_pay
from phaselead.gap.history import before_record, from_its_memory, history_um, stood_of, with_stood
from phaselead.gap.posterior import likelihood_of
from phaselead.gap.posterior.verdict import Claim
from phaselead.gap.records import GapRun
from phaselead.gap.residual import modelled_run, run_from_where_it_stood
from phaselead.gap.run import run_gap
from phaselead.identify import fit
from phaselead.model import Chain, catalogue, rest_plays
from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.effects import effect
from phaselead.model.effects.interface import STOOD_OFF
from phaselead.record.recording import AxisRecord
from trials import in_trials

RATE_HZ = 1000.0
LEAK = effect("charge_leakage")
LEAKS = ((LEAK, {"rate_per_s": 0.05}),)
BENT = AxisModel(
    time=TimeView(
        gain_um_per_V=10.0, u_range_V=(0.0, 8.0), rate_Hz=RATE_HZ, play_r_V=(0.3, 1.0), play_w_um_per_V=(0.5, 1.0),
        deadzone_d_V=(1.0, 3.0, 5.0), deadzone_s_um_per_V=(1.0, 1.0, 1.0),
    )
)  # fmt: skip
LOOPS = AxisModel(
    time=TimeView(
        gain_um_per_V=8.0, u_range_V=(-6.0, 6.0), rate_Hz=250.0,
        deadzone_d_V=(-2.0, 2.0), deadzone_s_um_per_V=(0.3, 0.3),
        play_r_V=(0.3, 1.0, 2.0, 3.5), play_w_um_per_V=(0.8, 0.6, 0.4, 0.3),
    )
)  # fmt: skip
KEPT = ("charge_leakage", "creep", "thermal_drift", "asymmetric_hysteresis", "saturation", "sensor_nonlinearity")
WITHOUT = tuple(name for name in catalogue() if name not in KEPT)


def leaking(rig, waves_V, rate_per_s, role, lost_V):
    """Records of a session in which a leak goes on from one to the next, and what is lost after it."""
    keeps, records = np.exp(-rate_per_s / rig.rate_Hz), []
    for kind, u in waves_V.items():
        lost, _ = lfilter([1 - keeps], [1, -keeps], u, zi=[keeps * lost_V])
        record = rig.record(u - np.concatenate([[lost_V], lost[:-1]]), f"{role}-{kind}")
        lost_V = float(lost[-1])
        records.append(replace(record, axes={"x": AxisRecord(u, record.axes["x"].x_um)}))
    return records, lost_V


@pytest.mark.parametrize("rate_per_s", [0.1, *in_trials(0.03)])
def test_a_leak_of_many_times_the_typical_rate_is_named_alone(rate_per_s):
    """Volts of eight are lost before the last records, on a stage with bends. A larger effect never loses its name;
    beside this one stood something unknown, and more of it the larger it was."""
    rig = Rig(3, rate_Hz=RATE_HZ, hidden={"asymmetric_hysteresis": 0.05})
    reference = [rig.record(u, f"reference-{kind}") for kind, u in waves(rig, 2.0).items()]
    train, lost_V = leaking(rig, waves(rig, 2.0), rate_per_s, "train", 0.0)
    holdout, lost_V = leaking(rig, waves(rig, 2.0), rate_per_s, "holdout", lost_V)
    assert lost_V > 1.0
    found = run_gap(fit(reference)[0], train, holdout, reference, without=WITHOUT)
    assert [one.name for one in found.effects] == ["charge_leakage"]
    assert found.verdicts == ("named",)
    _, _, (low, high) = found.effects[0].params["rate_per_s"]
    assert low <= rate_per_s <= high
    assert any("still had under way" in line for line in found.messages)
    (said,) = (line for line in found.doubts if "moves the voltage at the ceramic over" in line)
    assert "beyond that it is a guess" in said


@cache
def stood_off(amount, role="train"):
    """A run of a stage of which ``amount`` deviations had leaked before, and its residual about its mean beside the
    leak alone."""
    rng, t_s = np.random.default_rng(5), np.arange(4000) / RATE_HZ
    u_V = 4 + 3 * np.sin(2 * np.pi * 1.5 * t_s) + 0.5 * np.sin(2 * np.pi * 11 * t_s)
    run = GapRun("x", role, t_s, u_V, np.zeros(4000), None, 0, 4000, f"{role}.csv", {}, {})
    model = modelled_run(BENT, run)
    x_um = model.answer(with_stood(LEAKS, {"charge_leakage": (amount,)})) + 0.01 * rng.normal(size=4000)
    return replace(model, run=replace(run, x_um=x_um))


def reference():
    """The same run without a leak, as a reference."""
    model = stood_off(0.0)
    x_um = model.answer() + 0.01 * np.random.default_rng(6).normal(size=4000)
    return modelled_run(BENT, replace(model.run, role="reference", x_um=x_um))


@pytest.mark.parametrize("amount", [-1.0, -0.8, 0.1, 0.8, 1.9])
def test_all_that_had_stood_off_is_taken_out(amount):
    model = stood_off(amount)
    error = model.error(LEAKS)
    error = error - error.mean()
    assert np.std(error - history_um(model, LEAKS, error)) < 0.011
    (column,) = before_record(model, LEAKS)
    once = error - (column - column.mean()) @ np.linalg.lstsq(column - column.mean(), error, rcond=None)[0]
    assert abs(amount) < 0.5 or np.std(once) > 0.02  # in proportion it is not


@given(st.floats(0.003, 0.1), st.floats(1.0, 7.0), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
@settings(max_examples=15, deadline=None)
def test_what_is_taken_out_never_leaves_more(rate_per_s, middle_V, trend_um, wave_um):
    run = stood_off(0.0).run
    since_s = run.t_s - run.t_s[0]
    u_V = middle_V + 0.5 * np.sin(2 * np.pi * 1.5 * since_s)
    model = modelled_run(BENT, replace(run, u_V=u_V))
    error = trend_um * since_s + wave_um * np.sin(9 * since_s) + 0.01 * np.cos(40 * since_s)
    error = error - error.mean()
    left = error - history_um(model, ((LEAK, {"rate_per_s": rate_per_s}),), error)
    assert np.std(left) <= np.std(error) * (1 + 1e-9)


@pytest.mark.parametrize("began_V", [0.0, 2.0, 4.0])
@pytest.mark.parametrize("amount", [-0.8, 0.8])
def test_where_a_record_began_is_found_together_with_what_had_stood_off(began_V, amount):
    rng, t_s = np.random.default_rng(5), np.arange(4000) / RATE_HZ
    u_V = 4 + (began_V - 4) * np.cos(2 * np.pi * 1.5 * t_s) + 0.5 * np.sin(2 * np.pi * 11 * t_s)
    run = GapRun("x", "holdout", t_s, u_V, np.zeros(4000), None, 0, 4000, "a.csv", {}, {})
    truth = run_from_where_it_stood(BENT, run)
    x_um = truth.answer(with_stood(LEAKS, {"charge_leakage": (amount,)})) + 0.01 * rng.normal(size=4000)
    found = from_its_memory(modelled_run(BENT, replace(run, x_um=x_um)), LEAKS)
    error = found.error(LEAKS) - found.error(LEAKS).mean()
    assert np.std(error - history_um(found, LEAKS, error)) < 0.02


@cache
def elsewhere():
    """A likelihood of records cut out of one session each, without a leak and with one: where each began depends on all
    that went before, and on what had leaked by then."""
    rng, step_s, runs = np.random.default_rng(8), 1 / 250, []
    t_s = np.arange(1000) * step_s
    fading = 5 * np.linspace(1, 0, 1000) * np.sin(2 * np.pi * 0.75 * t_s)
    waves_V = [fading, 4 * np.sin(2 * np.pi * 1.25 * t_s), np.repeat([-3.0, 3.0, -2.0, 4.0], 250), 0.6 * fading]
    u_V = np.concatenate([np.concatenate([wave, np.zeros(250)]) for wave in waves_V])
    long_s = np.arange(len(u_V)) * step_s
    for acting, roles in (((), ("reference",) * 4), (LEAKS, ("train", "train", "holdout", "holdout"))):
        x_um = Chain(LOOPS, long_s, u_V).run(acting) + 0.005 * rng.normal(size=len(u_V))
        for i, role in enumerate(roles):
            rows = slice(1250 * i, 1250 * i + 1000)
            run = GapRun("x", role, t_s, u_V[rows], x_um[rows], None, 0, 1000, f"{i}.csv", {}, {})
            runs.append(modelled_run(LOOPS, run))
    return likelihood_of(runs)


@pytest.mark.parametrize("rate_per_s", [0.05, 0.02])
def test_records_that_are_cut_out_of_a_session_tell_its_leak(rate_per_s):
    """They begin at any voltage, of which some had leaked. While a steady voltage was taken to stay, a leak of five
    times the typical rate was said to be there at a hundredth of its size at most."""
    found = elsewhere().fit([(LEAK, {"rate_per_s": rate_per_s})])
    assert found.log_evidence > elsewhere().fit(()).log_evidence + 100
    assert found.entries[0][1]["rate_per_s"] == pytest.approx(0.05, rel=0.1)
    # The start has no part in the evidence.
    assert found.log_evidence == pytest.approx(elsewhere().fit(LEAKS).log_evidence, abs=1.0)


@pytest.mark.parametrize("other", ["gain_change", "sensor_nonlinearity", "backlash"])
def test_beside_a_leak_that_had_stood_off_something_else_is_not_put_down_to_it(other):
    """What stood off is known apart; it gives the equation of the leak no more to miss."""
    beside, named = catalogue()[other], []
    for size in (0.0, 5.0):
        params = {p.name: size * p.typical if p.role == "size" else p.typical for p in beside.parameters}
        runs = [reference()]
        for role, amount in (("train", 0.0), ("train", 0.3), ("holdout", 0.8)):
            model = stood_off(amount, role)
            answer = model.answer([*with_stood(LEAKS, {"charge_leakage": (amount,)}), (beside, params)])
            noise = 0.01 * np.random.default_rng(9).normal(size=4000)
            runs.append(replace(model, run=replace(model.run, x_um=answer + noise)))
        named.append(likelihood_of(runs).fit(LEAKS).named)
    assert named[0] > 0.5 > named[1]


def test_a_set_is_fitted_beside_what_stood_off():
    runs = [
        reference(),
        stood_off(0.0),
        stood_off(0.8, "holdout"),
    ]
    fitted = likelihood_of(runs).fit(LEAKS)
    assert [dict(of_run).get("charge_leakage", ()) for of_run in fitted.terms.stood[:1]] == [()]
    (there,), (later,) = (of_run["charge_leakage"] for of_run in fitted.terms.stood[1:])
    assert there == pytest.approx(0.0, abs=0.05)
    assert later == pytest.approx(0.8, rel=0.1)
    assert fitted.entries[0][1]["rate_per_s"] == pytest.approx(0.05, rel=0.1)


def test_a_steady_voltage_is_another_place_on_the_same_stage():
    """What stood off moves where the stage came from as well, with all its bends."""
    model, steady = stood_off(0.0), ((LEAK, {"rate_per_s": 1e-9}),)
    low, high = BENT.time.u_range_V
    run, more_V = model.run, 0.5 * STOOD_OFF * (high - low)
    start = (model.began.plays_V if model.began else rest_plays(BENT.time)) + more_V
    moved_um = model.answer(with_stood(steady, {"charge_leakage": (0.5,)}))
    moved = Chain(BENT, run.t_s, run.u_V + more_V, start=start).run()
    np.testing.assert_allclose(moved_um[1:], moved[1:], atol=1e-6)


def test_what_is_no_voltage_stands_nowhere():
    creep = effect("creep")
    entries = (*LEAKS, (creep, creep.typical))
    of = (0, 1, 1)
    assert stood_of(entries, of, np.array([0.5, 1.0, 2.0])) == {"charge_leakage": (0.5,)}
    assert [one.name for one, _ in with_stood(entries, {"creep": (1.0,)})] == [
        "charge_leakage",
        "creep",
        "creep before",
    ]


@pytest.mark.parametrize(("name", "held_out_log_odds", "kept"), [
    ("creep", -3.0, True), ("creep", -6.0, False), ("charge_leakage", 2.0, True), ("charge_leakage", -6.0, False),
])  # fmt: skip
def test_what_goes_on_between_records_is_asked_by_the_odds(name, held_out_log_odds, kept):
    """In um a large leak predicts worse than none where nobody knows what had leaked before. One in a hundred is the
    error rate."""
    claim = Claim(catalogue()[name], 0.999, 20.0, held_out_log_odds, (), (name,))
    likelihood = SimpleNamespace(runs=())
    assert (_that_pay(likelihood, ((claim.effect, claim.effect.typical),), [claim]) == (claim,)) == kept
