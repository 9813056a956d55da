"""What a base says beyond the voltages that it was fitted to is a guess, wherever the records or an effect lead it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig import Rig
from scipy.signal import lfilter
from test_gap_laws import waves

from phaselead.gap import run_gap
from phaselead.gap.base_refit import BASE_SEGMENTS, PLAY_STD, columns_beyond, mean_slope, span_of_fields
from phaselead.gap.history import with_stood
from phaselead.gap.posterior import likelihood_of
from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.gap.posterior.contest import search_sets
from phaselead.gap.posterior.equation_misfit import TIMES_BASE
from phaselead.gap.records import GapRun
from phaselead.gap.residual import modelled_run, run_from_where_it_stood
from phaselead.identify import fit
from phaselead.model import Chain, catalogue
from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.effects import effect

RATE_HZ = 250.0
LOW_V, HIGH_V = 0.0, 8.0
LEAK = effect("charge_leakage")
BASE = AxisModel(
    time=TimeView(
        gain_um_per_V=10.0, u_range_V=(LOW_V, HIGH_V), rate_Hz=RATE_HZ, play_r_V=(0.3, 1.0), play_w_um_per_V=(0.5, 1.0),
        deadzone_d_V=(1.0, 3.0, 5.0), deadzone_s_um_per_V=(0.3, 0.3, 0.3), rest_fraction=1.0,
    )
)  # fmt: skip
SEGMENT_V = (HIGH_V - LOW_V) / (BASE_SEGMENTS + 1)
KEPT = ("softening", "gain_change", "sensor_nonlinearity")
WITHOUT = tuple(name for name in catalogue() if name not in KEPT)


def run_of(u_V, x_um=None, role="train", name="a"):
    t_s = np.arange(len(u_V)) / RATE_HZ
    x_um = np.zeros(len(u_V)) if x_um is None else x_um
    return GapRun("x", role, t_s, u_V, x_um, None, 0, len(u_V), f"{name}.csv", {}, {})


@st.composite
def bases(draw):
    """A base of some bends, plays and field, fitted to voltages that hold 0 V, or not."""
    low_V, width_V = draw(st.floats(-9.0, 2.0)), draw(st.floats(4.0, 15.0))
    more = {
        "u_range_V": (low_V, low_V + width_V),
        "deadzone_d_V": tuple(low_V + share * width_V for share in (0.2, 0.5, 0.8)),
        "rest_fraction": draw(st.floats(-1.0, 1.0)),
        "field_bend": draw(st.sampled_from([0.0, -0.1, 0.2])),
        "play_tilt": draw(st.sampled_from([0.0, 0.3])),
    }
    return AxisModel(time=BASE.time.model_copy(update=more))


def swept(base, low_V, high_V):
    """A run under a base that goes from one voltage to the other and back."""
    way = np.concatenate([np.linspace(low_V, high_V, 600), np.linspace(high_V, low_V, 600)])
    return run_from_where_it_stood(base, run_of(way))


@given(bases(), st.floats(0.0, 0.4), st.floats(0.6, 1.0))
@settings(max_examples=20, deadline=None)
def test_where_no_record_goes_beyond_there_are_no_columns(base, begin, end):
    low_V, high_V = base.time.u_range_V
    run = swept(base, *(low_V + share * (high_V - low_V) for share in (begin, end)))
    assert columns_beyond(run, span_of_fields([(run, ())])).shape == (len(run.run.u_V), 0)


@given(bases(), st.floats(0.0, 6.0), st.floats(0.0, 12.0))
@settings(max_examples=20, deadline=None)
def test_every_run_has_the_same_columns_and_within_the_fitted_voltages_they_do_nothing(base, below_V, above_V):
    low_V, high_V = base.time.u_range_V
    far, near = swept(base, low_V - below_V, high_V + above_V), swept(base, low_V, high_V)
    span = span_of_fields([(far, ()), (near, ())])
    there, here = (columns_beyond(run, span) for run in (far, near))
    assert there.shape[1] == here.shape[1]
    assert np.allclose(here, 0.0, atol=1e-9)


def test_where_the_fit_ends_the_slope_is_as_uncertain_as_within():
    run = swept(BASE, LOW_V, HIGH_V + 2 * SEGMENT_V - 1e-9)
    columns = columns_beyond(run, span_of_fields([(run, ())]))
    past = np.maximum(run.run.u_V - HIGH_V, 0.0)
    bends = PLAY_STD * mean_slope(BASE) * np.stack([past, np.maximum(past - SEGMENT_V, 0.0)], axis=1)
    assert np.allclose(columns[:, -2:], bends, atol=1e-6)


@pytest.mark.parametrize("bend", [0.6, -0.6])
@pytest.mark.parametrize(("low_V", "high_V"), [(0.0, 8.0), (-8.0, 8.0), (-5.0, 10.0)])
def test_a_stage_that_bends_evenly_goes_on_by_one_deviation_of_the_first_column(low_V, high_V, bend):
    """Its slope changes by as much from knot to knot, within the fitted voltages and beyond."""
    knots_V = np.arange(low_V - 12, high_V + 12, 0.25) + 0.125
    inside = (knots_V > low_V) & (knots_V < high_V)
    view = BASE.time.model_copy(update={"play_r_V": (), "play_w_um_per_V": (), "u_range_V": (low_V, high_V)})
    base, whole = (
        AxisModel(time=view.model_copy(update={"deadzone_d_V": tuple(d), "deadzone_s_um_per_V": (bend / 4,) * len(d)}))
        for d in (knots_V[inside], knots_V[knots_V > low_V])
    )
    above = swept(base, low_V, high_V + 4)
    off_um = run_from_where_it_stood(whole, above.run).answer() - above.answer()
    column = columns_beyond(above, span_of_fields([(above, ())]))[:, 0]
    assert np.abs(off_um).max() > 4
    assert column == pytest.approx(off_um, abs=0.05 * np.abs(off_um).max())


@pytest.mark.parametrize("bend", [0.2, -0.2])
def test_a_bent_field_goes_on_bending_in_the_first_column(bend):
    view = BASE.time.model_copy(update={"field_bend": bend, "deadzone_d_V": (), "deadzone_s_um_per_V": ()})
    above = swept(AxisModel(time=view), LOW_V, HIGH_V + 3)
    column = columns_beyond(above, span_of_fields([(above, ())]))[:, 0]
    past_V = np.maximum(above.run.u_V - HIGH_V, 0.0)
    # From one end to the other the slope changes from 1 - 2 bend to 1 + 2 bend.
    expected = 4 * bend * mean_slope(AxisModel(time=view)) / (HIGH_V - LOW_V) / 2 * past_V**2
    assert column == pytest.approx(expected, rel=0.15, abs=1e-6)


def test_beyond_the_fit_and_nothing_hidden_no_name_is_given_and_it_is_said():
    """A stage that bends, whose references went over a part of its range."""
    rig, records = Rig(3, rate_Hz=1000.0, hidden={"asymmetric_hysteresis": 0.05}), []
    for role, level in (("reference", 0.7), ("train", 1.0), ("holdout", 1.0)):
        records.append([rig.record(level * u, f"{role}-{kind}") for kind, u in waves(rig, 1.5).items()])
    found = run_gap(fit(records[0])[0], *records[1:], records[0], without=WITHOUT)
    assert not found.effects
    assert not found.ties
    (said,) = (line for line in found.doubts if "the model was fitted from" in line)
    assert "beyond that it is a guess" in said


@cache
def leaking():
    """Runs of a stage that leaks below the voltages of its references, where it bends as these do not show."""
    rate_per_s, rng = 0.05, np.random.default_rng(4)
    view = BASE.time
    bends = (-1.2, -0.3, *view.deadzone_d_V), (0.4, 0.4, *view.deadzone_s_um_per_V)
    truth = AxisModel(time=view.model_copy(update={"deadzone_d_V": bends[0], "deadzone_s_um_per_V": bends[1]}))
    t_s, keeps, lost_V, runs = np.arange(2500) / RATE_HZ, np.exp(-rate_per_s / RATE_HZ), 0.0, []
    shapes = [
        np.minimum(1, np.minimum(t_s, t_s[-1] - t_s)) * (1 - np.cos(2 * np.pi * f * t_s)) for f in (0.3, 1.3, 4.7)
    ]
    for role in ("reference", "train", "holdout"):
        for i, shape in enumerate((*shapes, np.zeros(2500))):
            u_V = 0.5 * HIGH_V * shape * (0.8 if role == "holdout" else 1.0)
            lost, _ = lfilter([1 - keeps], [1, -keeps], u_V, zi=[keeps * lost_V])
            v_V = u_V if role == "reference" else u_V - np.concatenate([[lost_V], lost[:-1]])
            lost_V = 0.0 if role == "reference" else float(lost[-1])
            x_um = Chain(truth, t_s, v_V).run() + 0.005 * rng.normal(size=2500)
            runs.append(run_of(u_V, x_um, role, f"{role}{i}"))
    return rate_per_s, [modelled_run(BASE, run) for run in runs]


def test_where_a_leak_leads_the_stage_beyond_the_fit_nothing_else_gets_a_name():
    """A bend of the sensor stood beside the leak of a stage driven from 0 to 10 V, whose rate was a fifth too fast."""
    rate_per_s, runs = leaking()
    effects = [LEAK.as_known(), effect("sensor_nonlinearity").as_known()]
    contest = search_sets(likelihood_of(runs, base_may_be_off=True), effects, lambda share: None)
    alone = contest.fits[("charge_leakage",)]
    # A bend of no size costs little; a name takes log odds of 4.6, and without this the bend had 194.
    assert max(map(contest.log_posterior, contest.fits)) < contest.log_posterior(alone.names) + 2
    assert alone.entries[0][1]["rate_per_s"] == pytest.approx(rate_per_s, rel=0.1)


def test_the_base_misses_its_share_of_what_had_leaked_before_too():
    _, runs = leaking()
    likelihood = likelihood_of(runs)
    entries = [(LEAK, {"rate_per_s": 0.05})]
    stood = [{"charge_leakage": (-0.5,)} if run.changed else {} for run in likelihood.runs]
    nothing, moved = likelihood.terms(entries), likelihood.terms(entries, stood=stood)
    moved = replace(moved, signal=nothing.signal, of_material=nothing.of_material)
    more = likelihood.variance(moved, [0.1]) - likelihood.variance(nothing, [0.1])
    at_rest = np.concatenate(
        [np.full(len(run.sizes), run.changed and run.modelled.run.idle) for run in likelihood.runs]
    )
    assert (more[..., at_rest] > 0).all()
    powers = []
    for run, had in zip(likelihood.runs, stood, strict=True):
        answers = [run.modelled.answer(one) for one in (with_stood(entries, had) if had else entries, entries)]
        powers.append(run.spread(run.power(answers[0] - answers[1])))
    expected = np.array(TIMES_BASE)[:, None] ** 2 * likelihood.base_share * np.concatenate(powers)
    counts = ~likelihood._is_level
    assert np.allclose(more[0][:, counts], expected[:, counts])
    of_references = np.concatenate([np.full(len(run.sizes), not run.changed) for run in likelihood.runs])
    assert not more[..., of_references & counts].any()


def test_what_may_be_missed_beyond_makes_no_set_less_likely():
    """All that it looks like a leak had nothing at all settle at amounts of ten deviations, far below none of them."""
    _, runs = leaking()
    entries = [(LEAK, {"rate_per_s": 0.05})]
    before = likelihood_of(runs, base_may_be_off=True)
    after = before.missing_beyond(entries, before.fitted_terms(entries, steps=0)[0].stood)
    for some in ((), entries):
        less, more = (of.log_joint(of.terms(some), [0.02]).item() for of in (before, after))
        assert more > less - 1.0


def test_the_columns_beside_a_leak_take_the_place_of_those_of_the_records():
    _, runs = leaking()
    entries = [(LEAK, {"rate_per_s": 0.05})]
    before = likelihood_of(runs, base_may_be_off=True)
    once = before.missing_beyond(entries)
    twice = once.missing_beyond(entries)
    assert once.among_shared.size == twice.among_shared.size > before.among_shared.size
    assert all(np.allclose(one, other) for one, other in zip(once.shared, twice.shared, strict=True))
    elsewhere = BlockedRun(twice.runs[-1].modelled, twice.runs[-1].usual_um)
    assert twice.shared_in(elsewhere).shape[1] == twice.among_shared.size
