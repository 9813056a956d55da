"""Sizes far beyond the typical one: some stage somewhere has them, and the prior says so."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from test_far_above_references import answer, drifting, sessions

from phaselead.gap.posterior.likeliest import _likeliest
from phaselead.gap.posterior.priors import KNOWN_BEFORE, LARGEST, prior_of
from phaselead.model import catalogue


def log_density(name: str, *sizes: float) -> float:
    """Of sizes of an effect in typical values, in which all of its parameters are."""
    effect = catalogue()[name]
    params = {p.name: size * p.typical for p, size in zip(effect.parameters, sizes, strict=True)}
    return prior_of([(effect, params)]).log_density


@pytest.mark.parametrize(("name", "low"), [("gain_change", -np.inf), ("delay", 0.0)])
def test_all_sizes_together_are_certain(name, low):
    cuts = (low, -30.0, -1.0, 0.0, 1.0, 30.0, np.inf)
    parts = [(a, b) for a, b in itertools.pairwise(cuts) if a >= low and a < b]
    whole = sum(quad(lambda size: np.exp(log_density(name, size)), a, b)[0] for a, b in parts)
    assert whole == pytest.approx(1.0, abs=1e-3)


def test_two_sizes_together_are_certain_as_well():
    """Of rails, which are one-sided: over the quarter of a plane, in its polar coordinates."""
    radii = np.concatenate([[0.0], np.geomspace(1e-4, 1e5, 1500)])
    density = [np.exp(log_density("saturation", r * np.cos(0.4), r * np.sin(0.4))) for r in radii]
    assert np.trapezoid(np.pi / 2 * radii * density, radii) == pytest.approx(1.0, abs=2e-3)


@given(st.floats(-200.0, 200.0), st.floats(-200.0, 200.0))
def test_the_normal_distribution_that_is_like_the_prior_has_its_slope(one, other):
    """So that the most likely sizes are found by solving for them again and again."""
    effect = catalogue()["saturation"]
    sizes = np.abs([one, other]) + 0.01
    step = 1e-4 * (0.1 + sizes[0])
    up, down = (log_density("saturation", sizes[0] + s, sizes[1]) for s in (step, -step))
    params = {p.name: size * p.typical for p, size in zip(effect.parameters, sizes, strict=True)}
    precision = prior_of([(effect, params)]).precision
    assert (up - down) / (2 * step) == pytest.approx(-precision[0] * sizes[0], rel=1e-3, abs=1e-6)


@given(st.floats(1.0, 100.0))
def test_ten_times_as_much_is_less_likely_and_not_impossible(size):
    apart = log_density("gain_change", size) - log_density("gain_change", 10 * size)
    assert 0 < apart < 2.5 * np.log(10)


def test_ninety_five_of_a_hundred_sizes_are_below_what_is_known_before():
    below = sum(
        quad(lambda size: np.exp(log_density("gain_change", size)), a, b)[0] for a, b in ((0, 1), (1, KNOWN_BEFORE))
    )
    assert 2 * below == pytest.approx(0.95, abs=2e-3)


@pytest.mark.parametrize("rate_um_per_s", [0.02, 0.05, 0.1])
def test_a_drift_of_many_times_the_typical_rate_is_named_and_of_its_size(rate_um_per_s):
    """Records of two seconds, at rest as well; the typical rate is 0.002 um/s."""
    reference, train, holdout = sessions(delay_s=0.0)
    began_s = max(record.t_s[-1] for record in reference)
    found = answer(reference, *(drifting(records, rate_um_per_s, began_s) for records in (train, holdout)))
    assert found.verdicts == ("named",)
    (drift,) = found.effects
    assert drift.name == "thermal_drift"
    value, _, (low, high) = drift.params["ramp_um_per_s"]
    assert low <= rate_um_per_s <= high
    assert value == pytest.approx(rate_um_per_s, rel=0.3)


@given(st.floats(50, 1000), st.floats(100, 1e4), st.floats(0.1, 10))
def test_a_search_begins_at_a_size_far_out_where_the_records_say_so(times, squares, unit):
    """However little each record says of it: an effect that makes outliers of them leaves them little weight."""
    true = times / unit
    curvature = np.array([[squares / true**2]])
    amounts, gain = _likeliest(curvature[0] * true, curvature, unit, True)
    assert amounts[0] == pytest.approx(true, rel=0.1)
    assert 0 < gain < squares / 2


@given(st.floats(-1, 1), st.floats(1e-3, 1e3), st.integers(1, 3))
def test_and_never_at_one_that_brings_less_than_the_usual_sizes(times, squares, sizes):
    curvature = squares * np.eye(sizes)
    amounts, gain = _likeliest(curvature @ np.full(sizes, times), curvature, 1.0, True)
    usual = np.linalg.solve(curvature + np.eye(sizes) / LARGEST**2, curvature @ np.full(sizes, times))
    assert gain >= 0.5 * times * squares * usual.sum() - 1e-12
    assert (np.abs(amounts) <= abs(times) + 1e-9).all()
