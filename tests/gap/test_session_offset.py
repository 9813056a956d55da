"""A zero that moved is told from drift and from the scatter of records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.gap.disturbances.session_offset import RecordOffset, best_explained, session_shifts


def records(
    step_um: float, drift_um_per_s: float, scatter_um: float, seed: int
) -> tuple[list[RecordOffset], list[RecordOffset], list[RecordOffset]]:
    """Three sessions; the drift begins when the first has ended."""
    rng = np.random.default_rng(seed)
    times = np.arange(17) * 2.0 + np.repeat([0.0, 30.0, 40.0], [6, 6, 5])
    later = np.arange(17) >= 6
    means = drift_um_per_s * np.maximum(times - 10, 0) + scatter_um * rng.normal(size=17) + step_um * later
    idle = np.isin(np.arange(17), [0, 6, 12])
    found = [RecordOffset(float(t), float(m), bool(i)) for t, m, i in zip(times, means, idle, strict=True)]
    return found[:6], found[6:12], found[12:]


@given(st.integers(0, 10**6), st.floats(0.001, 0.1), st.sampled_from([-1, 1]))
def test_a_step_far_beyond_the_scatter_is_found(seed, scatter_um, sign):
    shifts = session_shifts(*records(sign * 60 * scatter_um, 0.0, scatter_um, seed))
    assert "offset" in best_explained(shifts)
    assert abs(shifts["offset"].amount - sign * 60 * scatter_um) < 4 * shifts["offset"].half


@given(st.integers(0, 10**6), st.floats(0.001, 0.1), st.sampled_from([-1, 1]))
def test_a_drift_far_beyond_the_scatter_is_found(seed, scatter_um, sign):
    shifts = session_shifts(*records(0.0, sign * scatter_um, scatter_um, seed))
    assert best_explained(shifts) == ("thermal_drift",)
    assert abs(shifts["thermal_drift"].amount - sign * scatter_um) < 4 * shifts["thermal_drift"].half


def test_a_step_is_rarely_doubted():
    """Chance lets one in a hundred look as if the records went on to drift."""
    found = [best_explained(session_shifts(*records(0.6, 0.0, 0.01, seed))) for seed in range(400)]
    assert set(found) <= {("offset",), ("offset", "thermal_drift"), ("thermal_drift", "offset")}
    assert found.count(("offset",)) >= 0.97 * len(found)


def test_a_step_that_may_go_on_is_tied_with_a_drift():
    parts = [[replace(r, mean_um=r.mean_um + 0.005 * (r.t_s > 20) * (r.t_s - 60)) for r in part]
             for part in records(3.0, 0.0, 0.05, 1)]  # fmt: skip
    assert set(best_explained(session_shifts(*parts))) == {"offset", "thermal_drift"}
    assert best_explained(session_shifts(*parts, none_drifts=True)) == ("offset",)


@given(st.integers(0, 10**6), st.floats(0.001, 0.1), st.sampled_from([-1, 1]))
def test_a_drift_that_has_begun_before_is_no_step(seed, scatter_um, sign):
    """A stage that drifts by 10 nm/s stood 3 um off when the next session began: it was named an offset."""
    shifts = session_shifts(*records(300 * scatter_um * sign, 2 * sign * scatter_um, scatter_um, seed))
    assert best_explained(shifts) == ("thermal_drift",)
    surely = session_shifts(
        *records(300 * scatter_um * sign, 2 * sign * scatter_um, scatter_um, seed), none_drifts=True
    )
    assert "offset" not in best_explained(surely)
    assert abs(shifts["thermal_drift"].amount - 2 * sign * scatter_um) < 4 * shifts["thermal_drift"].half


def test_a_sure_drift_stays_sure_beside_a_step_against_it():
    """The step, of six deviations, makes the drift likelier beside it than alone, and is itself not sure."""
    found = [best_explained(session_shifts(*records(-0.3, 0.02, 0.05, seed))) for seed in range(200)]
    assert set(found) <= {("thermal_drift",), ()}
    assert found.count(("thermal_drift",)) >= 0.85 * len(found)


@settings(max_examples=300)
@given(st.integers(0, 10**6))
def test_scatter_is_neither(seed):
    assert best_explained(session_shifts(*records(0.0, 0.0, 0.01, seed))) == ()


def test_a_shift_of_driven_records_alone_is_another_answer_and_no_other_zero():
    parts = [[replace(r, mean_um=0.0) if r.idle else r for r in part] for part in records(1.0, 0.0, 0.001, 0)]
    assert best_explained(session_shifts(*parts)) == ()


def at_rest(parts, reference_um_per_s: float, later_um_per_s: float, std_um_per_s: float = 0.001):
    """The same records where those at rest move so quickly."""
    rates = (reference_um_per_s, later_um_per_s, later_um_per_s)
    return [
        [replace(r, rate_um_per_s=rate, rate_std_um_per_s=std_um_per_s) if r.idle else r for r in part]
        for rate, part in zip(rates, parts, strict=True)
    ]


@pytest.mark.parametrize(("share", "drifts"), [(1.0, True), (0.0, True), (-0.1, True), (-0.5, False)])
@pytest.mark.parametrize("sign", [-1, 1])
def test_no_drift_moves_records_at_rest_back(share, drifts, sign):
    """A leak that had charged the stage wears off there: its means had gone as those of a drift. A warming may be
    over."""
    drift = 0.1 * sign
    parts = records(0.0, drift, 0.05, 2)
    found = session_shifts(*at_rest(parts, 0.0, share * drift))
    assert best_explained(found) == (("thermal_drift",) if drifts else ())
    assert any(shift.refuted for shift in found.values()) != drifts


@pytest.mark.parametrize("sign", [-1, 1])
def test_to_move_back_as_in_every_session_or_hardly_surely_refutes_no_drift(sign):
    drift = 0.1 * sign
    parts = records(0.0, drift, 0.05, 2)
    for seen in (at_rest(parts, -0.5 * drift, -0.5 * drift), at_rest(parts, 0.0, -0.5 * drift, std_um_per_s=0.05)):
        assert best_explained(session_shifts(*seen)) == ("thermal_drift",)


@given(st.integers(0, 10**6), st.sampled_from([-1, 1]), st.floats(0.0, 0.01))
def test_records_at_rest_that_stand_still_take_no_name_from_a_step(seed, sign, drift_um_per_s):
    parts = records(sign * 3.0, sign * drift_um_per_s, 0.05, seed)
    assert best_explained(session_shifts(*at_rest(parts, 0.0, 0.0))) == best_explained(session_shifts(*parts))


@given(st.integers(0, 10**6), st.floats(-0.1, 0.1), st.floats(0.0, 1000.0))
def test_how_fast_a_record_moves_is_told_with_its_error(seed, rate_um_per_s, began_s):
    t_s = began_s + np.arange(4000) / 200
    noise = np.random.default_rng(seed).normal(size=4000)
    told = RecordOffset.of(t_s, 3.0 + rate_um_per_s * (t_s - began_s) + noise, True)
    assert told.rate_std_um_per_s > 0.5 * np.sqrt(12 / 4000) / 20
    assert abs(told.rate_um_per_s - rate_um_per_s) < 6 * told.rate_std_um_per_s


def test_slow_noise_is_no_sure_rate():
    """Random walks without a drift: of a straight line through one its residual alone says little."""
    t_s, far = np.arange(2000) / 200, 0
    for seed in range(300):
        walk = np.cumsum(np.random.default_rng(seed).normal(size=2000))
        told = RecordOffset.of(t_s, walk, True)
        far += abs(told.rate_um_per_s) > 3 * told.rate_std_um_per_s
    assert far < 0.25 * 300


def test_a_step_seen_only_once_may_be_either():
    """All later records at one time: nothing says how they came there."""
    reference, train, _ = records(1.0, 0.0, 0.001, 0)
    at_once = [replace(r, t_s=60.0) for r in train]
    assert set(best_explained(session_shifts(reference, at_once, at_once))) == {"offset", "thermal_drift"}


def test_intervals_hold_the_truth_as_often_as_they_say():
    found = [session_shifts(*records(0.05, 0.0, 0.01, seed))["offset"] for seed in range(400)]
    assert 0.91 <= np.mean([abs(shift.amount - 0.05) < shift.half for shift in found]) <= 0.98


@given(st.integers(0, 10**6), st.floats(-0.08, 0.08), st.sampled_from([-1, 1]))
def test_an_interval_reaches_to_what_records_at_rest_say(seed, aside_um, sign):
    """A bend of the sensor that is found not quite shifts all driven records alike, and hardly those at rest."""
    parts = records(0.6 * sign, 0.0, 0.005, seed)
    reference, *later = parts
    bent = [[replace(r, mean_um=r.mean_um + aside_um * (not r.idle)) for r in part] for part in later]
    shift = session_shifts(reference, *bent)["offset"]
    assert abs(shift.amount - 0.6 * sign) < shift.half + 4 * 0.005
    assert shift.half > 0.5 * abs(aside_um) - 0.02


@pytest.mark.parametrize(("aside_um", "held"), [(0.0, (0.91, 0.99)), (0.05, (0.91, 1.0)), (0.2, (0.91, 1.0))])
def test_an_interval_holds_a_step_beside_a_shift_of_the_driven_records_alone(aside_um, held):
    inside = []
    for seed in range(300):
        reference, *later = records(3.0, 0.0, 0.01, seed)
        bent = [[replace(r, mean_um=r.mean_um + aside_um * (not r.idle)) for r in part] for part in later]
        shift = session_shifts(reference, *bent)["offset"]
        inside.append(abs(shift.amount - 3.0) < shift.half)
    assert held[0] <= np.mean(inside) <= held[1]


@pytest.mark.parametrize("aside_um", [0.2, 0.5])
def test_a_shift_of_the_driven_records_alone_is_no_drift(aside_um):
    """A drift fits it badly, and what fits badly scatters so much that records at rest seemed to bear it out."""
    for seed in range(200):
        rng = np.random.default_rng(seed)
        parts = []
        for begins_s, off_um in ((0, 0.0), (40, aside_um), (70, aside_um)):
            times, idle = begins_s + 2.0 * np.arange(13), np.arange(13) == 0
            means = off_um * ~idle + 0.01 * rng.normal(size=13)
            parts.append([RecordOffset(*map(float, at), bool(i)) for *at, i in zip(times, means, idle, strict=True)])
        assert best_explained(session_shifts(*parts)) == ()


def test_two_records_tell_no_scatter():
    few = [RecordOffset(0.0, 0.0, True), RecordOffset(1.0, 0.1)]
    assert not session_shifts(few, few * 3, few)
    assert not session_shifts(few * 3, few * 3, [])


@given(st.integers(0, 10**6), st.floats(0.01, 0.1))
def test_what_is_unexplained_must_be_small_beside_a_shift_and_no_more(seed, scatter_um):
    """It may shift the means as well; a zero that moved by many times as much did so by itself."""
    parts = records(100 * scatter_um, 0.0, scatter_um, seed)
    assert "offset" in best_explained(session_shifts(*parts, unexplained_um=15 * scatter_um))
    assert best_explained(session_shifts(*parts, unexplained_um=25 * scatter_um)) == ()


@given(st.integers(0, 10**6), st.floats(0.001, 0.1), st.floats(1.3, 5.0), st.sampled_from([-1, 1]))
def test_where_records_at_rest_stand_elsewhere_a_step_has_no_name_and_a_bound_that_holds_both(
    seed, scatter, times, sign
):
    step_um = sign * 60 * scatter
    reference, *later = records(step_um, 0.0, scatter, seed)
    later = [[replace(r, mean_um=r.mean_um + (times - 1) * step_um * r.idle) for r in part] for part in later]
    shift = session_shifts(reference, *later)["offset"]
    assert shift.not_at_rest
    assert not shift.sure
    assert shift.upper > times * abs(step_um) - 6 * scatter


@given(st.integers(0, 10**6), st.floats(0.001, 0.1))
def test_where_nothing_moved_records_at_rest_refute_nothing(seed, scatter):
    assert not any(shift.not_at_rest for shift in session_shifts(*records(0.0, 0.0, scatter, seed)).values())
