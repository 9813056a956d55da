"""What each rival must do wherever its own model of the stage is right."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rival_stages import FREQUENCIES_HZ, SWINGS_V, evidence, gain, lag
from scipy.signal import lfilter

from rivals import PATHS, Evidence, FeedForward
from rivals.bench import Reference
from rivals.evidence import TICK_S
from rivals.lead_lookup import lead_coefficient, looked_up
from rivals.paths import Path
from rivals.prandtl_ishlinskii import ModifiedInverse, Operator
from rivals.smith_predictor import PredictedLoop, Shape, designed, relative_error
from rivals.xu_li import peak_sensitivity, scaled_gains

numbers = st.floats(0.1, 5.0)
"""Of plays: the first above the least that an operator takes, a thousandth of all."""
few = settings(max_examples=40)
THRESHOLDS = np.array([0.0, 0.1, 0.3, 0.8, 1.5])


def operators(still, fast):
    return Operator(THRESHOLDS, np.array(still), np.array(fast), 500.0)


@few
@given(
    still=st.lists(numbers, min_size=5, max_size=5),
    fast=st.lists(numbers, min_size=5, max_size=5),
    wanted=st.lists(st.tuples(st.floats(-30, 30), st.floats(-800, 800)), min_size=1, max_size=40),
)
def test_inverse_of_plays_cancels_plays(still, fast, wanted):
    operator, inverse = operators(still, fast), operators(still, fast)
    for h, rate in wanted:
        u = inverse.solve(h, rate)
        inverse.move(u, rate)
        assert operator.move(u, rate) == pytest.approx(h, abs=1e-9)


@few
@given(weights=st.lists(numbers, min_size=5, max_size=5), wanted=st.lists(st.floats(-20, 20), max_size=40))
def test_inverse_is_the_closed_form_where_weights_stay(weights, wanted):
    """Kuhnen 2003, eqs. 16 to 18: the inverse of plays is plays with other thresholds and weights."""
    sums = np.cumsum(weights)
    thresholds = np.array([np.dot(weights[: i + 1], THRESHOLDS[i] - THRESHOLDS[: i + 1]) for i in range(5)])
    inverse_weights = np.r_[1 / sums[0], -np.array(weights[1:]) / (sums[1:] * sums[:-1])]
    closed = Operator(thresholds, inverse_weights, inverse_weights, 1.0)
    solved = operators(weights, weights)
    for h in wanted:
        u = solved.solve(h, 0.0)
        solved.move(u, 0.0)
        p = closed.p = [min(max(one, h - r), h + r) for one, r in zip(closed.p, thresholds, strict=True)]
        assert u == pytest.approx(float(np.dot(inverse_weights, p)), abs=1e-9)


@few
@given(knots=st.lists(numbers, min_size=3, max_size=3), wanted=st.lists(st.floats(0, 50), min_size=1, max_size=30))
def test_modified_inverse_cancels_dead_zones_too(knots, wanted):
    weights = [3.0, 1.0, 0.5, 0.2, 0.1]
    at_um, values = np.array([-50.0, 10.0, 30.0, 100.0]), np.cumsum([0.0, *knots]) * 20
    values -= np.interp(0.0, at_um, values)
    inverse, operator = ModifiedInverse(operators(weights, weights), at_um, values, 0.3), operators(weights, weights)
    for x_um in wanted:
        h = operator.move(inverse.step(x_um, 0.0), 0.0)
        assert np.interp(h + 0.3, values, at_um) == pytest.approx(x_um, abs=1e-9)


@few
@given(
    k=st.floats(1.0, 30.0), dead=st.floats(1.0, 12.0), corner_Hz=st.floats(5.0, 300.0), order=st.integers(1, 5),
    notched=st.booleans(), asked=st.lists(st.tuples(st.floats(-50, 50), st.floats(-5, 5)), min_size=20, max_size=40),
)  # fmt: skip
def test_smith_predictor_with_a_perfect_model_is_the_loop_without_delay_and_then_the_delay(
    k, dead, corner_Hz, order, notched, asked
):
    """And what pushes the stage is answered by the same loop."""
    shape = Shape(corner_Hz, order, (150.0, 0.1) if notched else None)
    wanted, pushed_um = np.array(asked).T
    undelayed_um = wanted - pushed_um
    pole = np.exp(-2 * np.pi * corner_Hz * TICK_S)
    for _ in range(order):
        undelayed_um = lfilter([1 - pole], [1, -pole], undelayed_um)
    undelayed_um = lfilter(*shape.section(), undelayed_um)
    ticks = np.arange(len(wanted))
    expected_um = np.interp(ticks - dead, np.arange(-1, len(ticks)), np.r_[0.0, undelayed_um]) + pushed_um

    loop = PredictedLoop(k, dead * TICK_S, shape)
    whole, part = int(dead), dead - int(dead)
    given_V = [0.0] * (whole + 2)
    for tick in ticks:
        measured_um = k * ((1 - part) * given_V[-whole] + part * given_V[-whole - 1]) + pushed_um[tick]
        assert measured_um == pytest.approx(expected_um[tick], abs=1e-6)
        given_V.append(loop.step(wanted[tick], measured_um))


def test_smith_predictor_is_robust_where_it_was_made_to_be():
    known = evidence()
    f_Hz = np.geomspace(0.5, 2000, 500)
    shape = designed(known)
    assert (np.abs(shape.response(f_Hz)) * relative_error(known, f_Hz)).max() < 1
    assert shape.corner_Hz > 5


@few
@given(lag_rad=st.floats(0.01, 1.2), f_Hz=st.floats(1.0, 300.0))
def test_lead_is_the_lag_that_was_looked_up(lag_rad, f_Hz):
    h = lead_coefficient(lag_rad, f_Hz)
    if np.tan(lag_rad) < np.tan(np.pi * f_Hz * TICK_S) ** -1:  # a single zero leads by no more
        lead = np.angle(1 + h * (1 - np.exp(-2j * np.pi * f_Hz * TICK_S)))
        assert lead == pytest.approx(lag_rad, abs=1e-9)


@pytest.mark.parametrize("swing", SWINGS_V)
@pytest.mark.parametrize("f_Hz", FREQUENCIES_HZ)
def test_look_up_leaves_no_phase_on_its_grid(swing, f_Hz):
    found_gain, found_lag = looked_up(evidence(), gain(swing) * swing, f_Hz)
    assert found_gain == pytest.approx(gain(swing), rel=1e-6)
    h = lead_coefficient(found_lag, f_Hz)
    left = np.angle(1 + h * (1 - np.exp(-2j * np.pi * f_Hz * TICK_S))) - lag(swing, f_Hz)
    assert left == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("swing", "f_Hz"), [(2.0, 4.0), (5.0, 10.0), (8.0, 17.0)])
def test_feed_forward_of_a_stage_that_is_its_model_is_equation_11(swing, f_Hz):
    range_um = gain(swing) * swing
    path = Path("", range_um, f_Hz, PATHS[0].shape)
    controller = FeedForward(evidence(), path, Reference(path, 0.03))
    for tick in (0, 100, 333):
        turns = 2 * np.pi * f_Hz * tick * TICK_S + lag(swing, f_Hz)
        assert controller.step(tick, 0.0) == pytest.approx(swing * (1 - np.cos(turns)) / 2, abs=2e-3 * swing)


def test_gains_are_the_published_ones_where_they_were_published_for():
    assert scaled_gains(evidence()) == pytest.approx((0.017, 8.62, 2.33e-5), rel=0.05)


def test_gains_scale_with_the_stage_and_keep_the_margin_that_the_published_ones_had():
    one, other = evidence(), evidence(steeper=3.0, f0_Hz=450.0)
    assert scaled_gains(evidence(steeper=2.0))[1] == pytest.approx(scaled_gains(evidence())[1] / 2, rel=1e-6)
    assert peak_sensitivity(other, scaled_gains(one)) == np.inf
    assert peak_sensitivity(other, scaled_gains(other)) < 2.4


def test_evidence_comes_back_from_its_file(tmp_path):
    known = evidence()
    known.save(tmp_path / "evidence.npz")
    again = Evidence.load(tmp_path / "evidence.npz")
    assert [one.response for one in again.sines] == [one.response for one in known.sines]
    assert (again.gain == known.gain).all()
    assert again.u_limits_V == known.u_limits_V
