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
from phaselead.gap.base_refit import BASE_SEGMENTS, PLAY_STD, columns_beyond, reach_V
from phaselead.gap.posterior import likelihood_of
from phaselead.gap.posterior.missed import TIMES_BASE
from phaselead.gap.posterior.search import search_sets
from phaselead.gap.records import GapRun
from phaselead.gap.regressors import mean_slope
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
WITHOUT = tuple(name for name in catalogue() if name not in ("softening", "gain_change", "sensor_nonlinearity"))


def run_of(u_V, x_um=None, role="train", name="a"):
    t_s = np.arange(len(u_V)) / RATE_HZ
    x_um = np.zeros(len(u_V)) if x_um is None else x_um
    return GapRun("x", role, t_s, u_V, x_um, None, 0, len(u_V), f"{name}.csv", name, {}, {})


def swept(low_V, high_V):
    """A run under the base that goes from 0 V to one voltage and to the other."""
    way = np.concatenate([np.linspace(0, high_V, 300), np.linspace(high_V, low_V, 600), np.linspace(low_V, 0, 300)])
    return run_from_where_it_stood(BASE, run_of(way))


@given(st.floats(0.0, HIGH_V), st.floats(0.1, HIGH_V))
@settings(max_examples=20, deadline=None)
def test_within_the_fitted_voltages_nothing_is_beyond(low_V, high_V):
    run = swept(min(low_V, high_V), high_V)
    assert columns_beyond(run, reach_V([(run, ())])).shape == (len(run.run.u_V), 0)


@given(st.floats(0.0, 6.0), st.floats(0.0, 12.0))
@settings(max_examples=20, deadline=None)
def test_every_run_has_the_same_columns_and_within_the_fitted_voltages_they_do_nothing(below_V, above_V):
    far, near = swept(-below_V, HIGH_V + above_V), swept(LOW_V, HIGH_V)
    reach = reach_V([(far, ()), (near, ())])
    there, here = (columns_beyond(run, reach) for run in (far, near))
    assert there.shape[1] == here.shape[1]
    assert np.allclose(here, here[:1], atol=1e-9)


def test_where_the_fit_ends_the_slope_is_as_uncertain_as_within():
    run = swept(LOW_V, HIGH_V + 2 * SEGMENT_V - 1e-9)
    columns = columns_beyond(run, reach_V([(run, ())]))
    past = np.maximum(run.run.u_V - HIGH_V, 0.0)
    bends = PLAY_STD * mean_slope(BASE) * np.stack([past, np.maximum(past - SEGMENT_V, 0.0)], axis=1)
    assert np.allclose(columns[:, -2:], bends, atol=1e-6)


def test_beyond_the_fit_and_nothing_hidden_no_name_is_given_and_it_is_said():
    """A stage whose gain grows with the voltage, whose references went over a part of it."""
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
    best = max(contest.fits.values(), key=lambda one: contest.log_posterior(one.names))
    assert best.names == ("charge_leakage",)
    assert best.entries[0][1]["rate_per_s"] == pytest.approx(rate_per_s, rel=0.1)


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
    expected = np.array(TIMES_BASE)[:, None] ** 2 * likelihood.base_share * moved.moved_before
    counts = ~likelihood._is_level
    assert np.allclose(more[0][:, counts], expected[:, counts])
    of_references = np.concatenate([np.full(len(run.sizes), not run.changed) for run in likelihood.runs])
    assert not more[..., of_references & counts].any()
