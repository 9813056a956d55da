"""Where records stand: from record to record their means tell how the zero moves, and by themselves nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace as Made

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_far_above_references import drifting, sessions

from phaselead.gap.best_prediction import best_predicting
from phaselead.gap.derived import derived_of
from phaselead.gap.findings import NamedEffect, Posterior
from phaselead.gap.posterior import Contest, likelihood_of
from phaselead.gap.posterior.blocks import FEWEST_LEVELS, OF_LEVEL, blocked
from phaselead.gap.posterior.noise_and_base_share import noise_and_base_share_of
from phaselead.gap.posterior.starts import Starts
from phaselead.gap.records import axis_runs, taken_at_once
from phaselead.gap.residual import modelled_run
from phaselead.identify import fit
from phaselead.model import AdoptedEffect, AxisModel, Scene, TimeView, catalogue

DRIFT, LATE = catalogue()["thermal_drift"], catalogue()["delay"]
TRUE_um_per_s = 0.01
LINE = AxisModel(time=TimeView(gain_um_per_V=10.0, u_range_V=(0.0, 10.0), rate_Hz=1000.0))


def drift(ramp_um_per_s, rise_um=0.0):
    return DRIFT, DRIFT.complete({"ramp_um_per_s": ramp_um_per_s, "rise_um": rise_um, "tau_s": 300.0})


def runs_of(role, idle=False, began_s=0.0, count=1, length_s=2.0):
    """Records of a straight line at 0 V, one after the other."""
    found = []
    for i in range(count):
        t_s = began_s + (i + 1) * length_s + 1e-3 * np.arange(1000)
        run = Made(
            role=role, start=0, stop=1000, rows=slice(0, 1000), t_s=t_s, step_s=1e-3, driven=not idle, idle=idle,
            span_s=(t_s[0], t_s[-1]),
        )  # fmt: skip
        found.append(Made(run=run, axis=LINE, nuisances=np.ones((1000, 1)), answer=_nothing, error=_nothing))
    return found


def _nothing(entries=()):
    return np.zeros(1000)


@given(st.integers(0, 5), st.booleans())
def test_levels_count_where_references_tell_their_scatter_and_no_two_records_are_of_one_time(count, at_one_time):
    references = runs_of("reference", count=count)
    later = [*runs_of("train", count=3, began_s=100.0), *runs_of("train", began_s=100.0 if at_one_time else 150.0)]
    rest = runs_of("holdout", idle=True, began_s=200.0)
    count_levels = count >= FEWEST_LEVELS and not at_one_time
    for run in blocked([*references, *later, *rest]):
        levelled = count_levels and run.modelled.run.driven
        assert run.levelled == levelled
        assert (run.octaves == OF_LEVEL).tolist() == [levelled and i == 0 for i in range(len(run.octaves))]
        assert len(run.coefficients(np.zeros((1000, 1)))) == run.sizes.sum() == run.edges[-1]


@given(st.floats(-1e3, 1e3), st.integers(0, 99))
def test_a_level_is_the_mean_and_changes_no_octave(offset_um, seed):
    few, many = (blocked([*runs_of("reference", count=n), *runs_of("train", began_s=100.0)])[-1] for n in (1, 5))
    columns = np.random.default_rng(seed).normal(size=(1000, 2))
    with_level, without = many.coefficients(columns + offset_um), few.coefficients(columns)
    np.testing.assert_allclose(with_level[0], columns[many.skipped :].mean(axis=0) + offset_um, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(with_level[1:], without, atol=1e-8)
    assert np.array_equal(many.octaves[1:], few.octaves)
    power = np.arange(1.0, len(many.sizes) + 1)
    np.testing.assert_allclose(many.spread(power)[1:], few.spread(power[1:]))
    assert many.spread(power)[0] == power[0]


@cache
def recorded(ramp_um_per_s=0.0, gone_s=0.0, zero_um=0.0, clock_s=0.0, at_one_time=False):
    """Runs of three sessions of which the later two drift; ``gone_s`` before the held-out one, whose zero was moved by
    ``zero_um``; ``clock_s`` later by the clock; ``at_one_time``: each record begins at 0 s."""
    reference, train, holdout = sessions(delay_s=0.0, seconds=1.0)
    began_s = max(record.t_s[-1] for record in reference)
    train, holdout = (drifting(records, ramp_um_per_s, began_s) for records in (train, holdout))
    holdout = [replace(record, t_s=record.t_s + gone_s) for record in drifting(holdout, 0.0, 0.0)]
    holdout = [
        replace(r, axes={name: replace(one, x_um=one.x_um + zero_um) for name, one in r.axes.items()}) for r in holdout
    ]
    reference, train, holdout = (
        [replace(r, t_s=r.t_s + (-r.t_s[0] if at_one_time else clock_s)) for r in part]
        for part in (reference, train, holdout)
    )
    stage = fit(reference)[0]
    return [modelled_run(stage.axes["x"], run) for run in axis_runs(stage, train, holdout, reference)["x"]]


def test_two_windows_of_one_file_are_of_two_times():
    """The rows before a window belong to the run, and are not of its time."""
    t_s = 1e-3 * np.arange(4000.0)
    one, other = (Made(role="train", span_s=(t_s[a], t_s[b])) for a, b in ((0, 1999), (2000, 3999)))
    assert not taken_at_once([one, other])
    assert taken_at_once([one, one])
    assert not taken_at_once([one, Made(role="holdout", span_s=one.span_s)])


def odds(runs, entries):
    likelihood = likelihood_of(runs)
    return likelihood.fit(entries, steps=20).log_evidence - likelihood.fit(()).log_evidence


def test_where_records_stand_tells_a_drift_that_hardly_shows_within_them():
    """10 nm in a record of a second, of which its own memory may explain most; 180 nm from one to the other."""
    told = odds(recorded(TRUE_um_per_s), [drift(TRUE_um_per_s)])
    assert told > 10
    assert odds(recorded(TRUE_um_per_s, at_one_time=True), [drift(TRUE_um_per_s)]) < 0.3 * told
    assert odds(recorded(), [drift(TRUE_um_per_s)]) < 0


@pytest.mark.parametrize(
    "elsewhere", [{"zero_um": 3.0}, {"zero_um": -1e4}, {"gone_s": 86400.0}, {"gone_s": 3e6}, {"clock_s": 1.7e9}]
)
def test_where_the_zero_of_a_session_was_set_and_what_the_clock_said_changes_nothing(elsewhere):
    as_it_was, moved = (odds(recorded(TRUE_um_per_s, **more), [drift(TRUE_um_per_s)]) for more in ({}, elsewhere))
    assert moved == pytest.approx(as_it_was, abs=1.0)


def test_a_session_of_one_record_says_nothing_of_where_records_stand():
    runs = [run for run in recorded(TRUE_um_per_s) if run.run.role == "reference"]
    runs += [next(run for run in recorded(TRUE_um_per_s) if run.run.role == "train" and run.run.driven)]
    assert odds(runs, [drift(TRUE_um_per_s)]) < 1


def test_a_record_at_rest_more_adds_nothing_to_levels():
    likelihood = likelihood_of(recorded(TRUE_um_per_s))
    fewer = likelihood_of([run for run in recorded(TRUE_um_per_s) if run.run.driven])
    signals = [one.terms([drift(TRUE_um_per_s)]).signal[_levels(one)] for one in (likelihood, fewer)]
    np.testing.assert_allclose(*signals)
    assert 0 < signals[0].max() < (0.5 * TRUE_um_per_s * 60) ** 2


def _levels(likelihood):
    return np.concatenate([run.octaves == OF_LEVEL for run in likelihood.runs])


@pytest.mark.parametrize("off_um", [0.05, 0.5])
def test_one_record_that_stands_elsewhere_is_no_drift(off_um):
    """Its plays stood elsewhere before, say."""
    found = recorded()
    runs = [_standing_off(run, off_um) if run is found[1] else run for run in found]
    likelihood = likelihood_of(runs)
    fit_of = {0: likelihood.fit(()), 1: likelihood.fit([drift(TRUE_um_per_s)], steps=20)}
    assert fit_of[1].log_evidence - fit_of[0].log_evidence < 4


def _standing_off(modelled, off_um):
    return replace(modelled, run=replace(modelled.run, x_um=modelled.run.x_um + off_um))


def test_what_a_creeping_base_may_still_carry_makes_its_levels_say_less():
    creeping = AdoptedEffect(name="creep", params={"gamma": 0.01, "tau_first_s": 0.1, "tau_last_s": 100.0})
    runs = [*runs_of("reference", count=4), *runs_of("train", count=3, began_s=100.0)]
    known = {}
    for creeps, of in ((False, runs), (True, [_under(run, creeping) for run in runs])):
        found = blocked(of)
        expected = noise_and_base_share_of(found)
        known[creeps] = [sum(expected.of(run, run.motion)[i][0] for i in (0, 1)) for run in found]
    assert min(known[True]) > 100 * max(known[False])


def _under(modelled, effect):
    return Made(**{**vars(modelled), "axis": LINE.model_copy(update={"effects": (effect,)})})


def test_another_effect_is_adopted_about_each_records_own_mean():
    runs = [run for run in recorded() if run.run.role == "train"]
    shifted = [_standing_off(run, 5.0 * i) for i, run in enumerate(runs)]
    late, levelled = [(LATE, {"delay_s": 1e-4})], [run.run.driven for run in runs]
    adopted = [best_predicting(late, 0.01 * np.eye(1), of, levelled) for of in (runs, shifted)]
    assert adopted[0][0][1]["delay_s"] == pytest.approx(adopted[1][0][1]["delay_s"], rel=1e-6)


def test_what_predicts_best_follows_where_the_records_stand():
    runs = [run for run in recorded(TRUE_um_per_s) if run.run.role == "train"]
    ((_, params),) = best_predicting(
        [drift(0.2 * TRUE_um_per_s)], 100.0 * np.eye(3), runs, [r.run.driven for r in runs]
    )
    spans_s = tuple((float(run.run.t_s[0]), float(run.run.t_s[-1])) for run in runs)
    nm_per_min = DRIFT.derived[0].value(params, Scene(LINE, spans_s))
    assert nm_per_min == pytest.approx(60e3 * TRUE_um_per_s, rel=0.2)


@given(st.floats(-0.999, 0.999), st.floats(0.01, 1.0))
def test_what_two_parameters_come_to_is_known_as_well_as_both_together(together, off):
    """Of a ramp and a warming with a long time constant, whose rates add up."""
    params = {"ramp_um_per_s": 0.002, "rise_um": 0.1, "tau_s": 1e5}
    deviations = np.array([0.001, 100.0, 1e-9])
    correlation = np.array([[1.0, together, 0.0], [together, 1.0, 0.0], [0.0, 0.0, 1.0]])
    posterior = Posterior(params, np.outer(deviations, deviations) * correlation)
    units = {"ramp_um_per_s": "um/s", "rise_um": "um", "tau_s": "s"}
    adopted = {**params, "ramp_um_per_s": 0.002 + off * 0.001}
    estimates = {name: (adopted[name], units[name], (adopted[name], adopted[name])) for name in params}
    effect = NamedEffect("thermal_drift", estimates, 0.0, posterior=posterior)
    (found,) = derived_of(effect, Scene(LINE, ((0.0, 10.0), (20.0, 30.0)))).values()
    value, _, (low, high) = found
    sd = np.sqrt(0.001**2 + 0.001**2 + 2 * together * 0.001**2)
    expected = 60e3 * (1.96 * sd + off * 0.001)
    assert value == pytest.approx(60e3 * (adopted["ramp_um_per_s"] + 1e-6), rel=1e-3)
    assert high - value == pytest.approx(expected, rel=1e-2, abs=1e-3)
    assert value - low == pytest.approx(expected, rel=1e-2, abs=1e-3)


def test_where_records_stand_speaks_neither_for_nor_against_what_goes_on_between_them():
    likelihood, creep = likelihood_of(recorded(TRUE_um_per_s)), catalogue()["creep"]
    creeping = [(creep, creep.complete({creep.sizes[0].name: creep.sizes[0].typical}))]
    fits = [likelihood.fit(entries, steps=10) for entries in ((), [drift(TRUE_um_per_s)], creeping)]
    contest = Contest(likelihood, {fit.names: fit for fit in fits}, Starts(likelihood, [DRIFT, creep]))
    of_nothing, of_drift, of_creep = fits
    assert of_drift.log_levels > of_nothing.log_levels + 5
    assert contest.log_evidence(()) == of_nothing.log_evidence
    elsewhere = likelihood_of([_standing_off(run, 0.02 * i) for i, run in enumerate(recorded(TRUE_um_per_s))])
    moved = elsewhere.fit(of_creep.entries, steps=0)
    assert moved.log_evidence == pytest.approx(likelihood.fit(of_creep.entries, steps=0).log_evidence, abs=0.5)
    granted = contest.log_evidence(("creep",)) - of_creep.log_evidence
    assert granted == pytest.approx(of_drift.log_levels - of_creep.log_levels)
