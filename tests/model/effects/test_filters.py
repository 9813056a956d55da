"""The kernel of the effects against plain Python and exact answers."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import solve_ivp
from scipy.special import gammainc

from phaselead.model.effects.filters import (
    behind_modes,
    lags,
    mode_coefficients,
    relaxed,
    relaxed_late,
    resonant,
    second_order_residual,
    smoothly_relaxed,
)
from phaselead.model.effects.slew_limit import slewed

rows = st.integers(1, 40).flatmap(
    lambda n: arrays(np.float64, n, elements=st.floats(-10, 10).map(lambda v: round(v, 6)))
)
laws = settings(max_examples=60, deadline=None)


def lag_by_steps(x: np.ndarray, tau: float, step: float) -> np.ndarray:
    """tau s' = x - s with x straight between rows, solved exactly from row to row."""
    s = [x[0]]
    for a, b in pairwise(x):
        slope = (b - a) / step
        particular = a - slope * tau
        s.append(b - slope * tau + (s[-1] - particular) * np.exp(-step / tau))
    return np.array(s)


@laws
@given(rows, st.floats(1e-3, 1e3), st.floats(-2, 2))
def test_lags_are_exact(x, tau, gain):
    found = lags(x, [tau, 0.0], [gain, 1.0], 0.1)
    assert np.allclose(found, gain * lag_by_steps(x, tau, 0.1) + x, atol=1e-8)


@laws
@given(rows, st.sampled_from([1e-300, 1e-12, 1e-6, 1.0, 1e5, 1e12]))
def test_lags_of_any_time_constant_stay_between_the_extremes(x, tau):
    y = lags(x, [tau], [1.0], 1e-3)
    assert y.min() >= x.min() - 1e-9
    assert y.max() <= x.max() + 1e-9


def test_very_slow_lags_keep_their_digits():
    x = np.concatenate([np.zeros(1), np.ones(100_000)])
    y = lags(x, [1e4], [1.0], 2e-4)
    assert y[-1] == pytest.approx(-np.expm1(-(100_000 - 0.5) * 2e-4 / 1e4), rel=1e-9)


@laws
@given(rows, st.floats(1e-3, 30))
def test_slewed(x, rise):
    y = slewed(x, rise)
    assert y[0] == x[0]
    assert (np.abs(np.diff(y)) <= rise * (1 + 1e-12) + 1e-12).all()
    arrived = np.abs(np.diff(y)) < rise * (1 - 1e-12)
    assert np.array_equal(y[1:][arrived], x[1:][arrived])


@laws
@given(rows, st.floats(1e-3, 30), st.floats(1e-3, 10))
def test_slewed_softly(x, rise, loop_rows):
    """Each row lags as its rate asks for; where a rate is all but the limit, its lag has no digits left."""
    y = slewed(x, rise, loop_rows)
    part = np.diff(y) / rise
    assert (np.abs(part) <= 1 + 1e-9).all()
    soft = np.abs(part) < 0.999
    lag = rise * loop_rows * (np.arctanh(part[soft]) - part[soft])
    assert x[1:][soft] - y[1:][soft] == pytest.approx(lag, rel=1e-6, abs=1e-9)


def test_a_tanh_from_step_to_step_is_a_soft_limit_of_one_row():
    """dy = S tanh((x - y) / S), as simulated elsewhere."""
    x = 40 * np.sin(np.arange(300) / 7)
    y = np.zeros(300)
    for k in range(1, 300):
        y[k] = y[k - 1] + 5 * np.tanh((x[k] - y[k - 1]) / 5)
    assert slewed(x, 5.0, 1.0) == pytest.approx(y, abs=1e-9)


@pytest.mark.parametrize("zeta", [0.03, 1.0, 4.0])
def test_modes_are_exact_for_straight_input(zeta):
    rng = np.random.default_rng(0)
    x, step, f = np.concatenate([[0.0], rng.uniform(-1, 1, 30)]), 0.01, 17.0
    w = 2 * np.pi * f

    def slope(t: float, s: np.ndarray) -> list[float]:
        return [s[1], w**2 * (np.interp(t, np.arange(31) * step, x) - s[0]) - 2 * zeta * w * s[1]]

    exact = solve_ivp(
        slope, (0, 0.3), [0.0, 0.0], t_eval=np.arange(31) * step, max_step=step / 10, rtol=1e-9, atol=1e-10
    )
    assert resonant(x, f, zeta, step) == pytest.approx(exact.y[0], abs=1e-5)


@pytest.mark.parametrize("columns", [1, 2, 5])
def test_modes_share_the_motion_of_every_column(columns):
    x, modes, step = np.random.default_rng(0).normal(size=(50, columns)), [(0.7, 17.0, 0.03), (0.3, 30.0, 0.1)], 0.01
    for column, found in zip(x.T, behind_modes(x, modes, step).T, strict=True):
        changes = [c * (resonant(column, f, zeta, step) - column) for c, f, zeta in modes]
        assert np.allclose(found, column + sum(changes), rtol=0, atol=1e-12)
        assert np.allclose(behind_modes(column, modes, step), found, rtol=0, atol=1e-12)


@pytest.mark.parametrize("rows", [slice(None), slice(3, 40, 3), slice(59, None), slice(0, 2)])
def test_what_a_mode_leaves_is_counted_without_making_it(rows):
    rng = np.random.default_rng(0)
    x, step = rng.normal(size=60), 0.01
    measured = x + rng.normal(size=60)
    y = resonant(x, 17.0, 0.03, step)
    left, late = (measured - y)[rows], np.gradient(y, step)[rows]
    expected = np.cov(left, late, bias=True) if len(left) > 1 else np.zeros((2, 2))
    found = second_order_residual(
        x, measured, mode_coefficients(17.0 * step, 0.03), step, np.arange(60, dtype=np.uintp)[rows]
    )
    assert found == pytest.approx((expected[0, 0], expected[0, 1], expected[1, 1]), rel=1e-9, abs=1e-9)


def test_a_mode_damped_beyond_all_sense_is_a_slow_lag():
    """cosh of its poles overflows."""
    x, step, zeta = np.concatenate([[0.0], np.ones(50)]), 0.01, 1e4
    lag = 1 - np.exp(-2 * np.pi * 17.0 * step / (2 * zeta) * (np.arange(51) - 0.5))
    assert resonant(x, 17.0, zeta, step)[1:] == pytest.approx(lag[1:], rel=1e-3)


@pytest.mark.parametrize("tau_s", [2e-5, 8e-5, 5e-4])
def test_a_lag_behind_a_mode_follows_the_way_between_the_rows(tau_s):
    step_s, finer = 2e-4, 40
    x = np.interp(np.arange(300), [0, 20, 21, 120, 180, 299], [0, 0, 3, 3, 1, 2])
    rows = np.arange(299 * finer + 1) / finer
    moved = resonant(np.interp(rows, np.arange(300), x), 400.0, 0.04, step_s / finer)
    exact = relaxed(moved, tau_s, step_s / finer)[::finer]
    straight = np.abs(relaxed(moved[::finer], tau_s, step_s) - exact).max()
    assert np.abs(smoothly_relaxed(moved[::finer], tau_s, step_s) - exact).max() < 0.2 * straight


def test_a_lag_of_nothing_changes_nothing():
    x = np.random.default_rng(0).normal(size=20)
    assert np.array_equal(smoothly_relaxed(x, 0.0, 1e-3), x)
    assert np.allclose(smoothly_relaxed(np.full(20, 3.0), 1e-3, 1e-3), 3.0)


@laws
@given(rows, st.floats(0, 3.5), st.floats(1e-5, 1e-2))
def test_a_late_lag_is_read_on_its_way_between_rows(x, late_rows, tau_s):
    step_s, finer = 2e-4, 50
    late_rows = round(late_rows * finer) / finer
    way = relaxed(np.interp(np.arange((len(x) - 1) * finer + 1) / finer, np.arange(len(x)), x), tau_s, step_s / finer)
    at = np.arange(len(x)) * finer - round(late_rows * finer)
    expected = np.where(at < 0, x[0], way[np.maximum(at, 0)])
    assert np.allclose(relaxed_late(x, [tau_s], step_s, late_rows * step_s), expected, atol=1e-8)


def behind_equal_lags(t: np.ndarray, count: int) -> np.ndarray:
    """A ramp of 1 from t = 0, in time constants, behind ``count`` equal lags, by a gamma distribution:
    t P(n, t) - n P(n + 1, t)."""
    t = np.maximum(t, 0.0)
    return t * gammainc(count, t) - count * gammainc(count + 1, t)


@laws
@given(rows, st.floats(0, 3.5), st.floats(1e-5, 1e-2), st.integers(2, 6))
def test_equal_lags_in_turn_are_the_closed_form_of_every_ramp(x, late_rows, tau_s, count):
    step_s = 2e-4
    at = np.arange(len(x)) - late_rows
    bends = np.diff(np.diff(x, prepend=x[0]), prepend=0.0, append=0.0)[1:]  # of the slope, after each row
    ramps = behind_equal_lags((at[:, None] - np.arange(len(x))) * step_s / tau_s, count) * tau_s / step_s
    expected = x[0] + ramps @ bends
    found = relaxed_late(x, [tau_s] * count, step_s, late_rows * step_s)
    assert np.allclose(found, expected, rtol=0, atol=1e-8 * max(np.ptp(x), 1.0))


@laws
@given(rows, st.floats(0, 3.5), st.lists(st.sampled_from([1e-5, 1e-4, 1.00001e-4, 1e-3, 1e-2]), min_size=2, max_size=5))
def test_lags_in_turn_are_the_partial_fractions_of_them_where_those_are_known(x, late_rows, taus_s):
    """Of different lags; alike ones among them are as good as equal."""
    step_s = 2e-4
    apart = sorted({round(tau_s, 6) for tau_s in taus_s})
    expected = sum(
        np.prod([tau_s / (tau_s - other) for other in apart if other != tau_s])
        * relaxed_late(x, [tau_s], step_s, late_rows * step_s)
        for tau_s in apart
    )
    assert np.allclose(relaxed_late(x, apart, step_s, late_rows * step_s), expected, atol=1e-8 * max(np.ptp(x), 1.0))
    alike = [tau_s * (1 + 1e-9) for tau_s in taus_s]
    once = relaxed_late(x, taus_s, step_s, late_rows * step_s)
    assert np.allclose(relaxed_late(x, alike, step_s, late_rows * step_s), once, atol=1e-6 * max(np.ptp(x), 1.0))


def test_lags_of_nothing_only_delay():
    x = np.random.default_rng(0).normal(size=20)
    assert np.allclose(relaxed_late(x, [0.0, 0.0], 1e-3, 2e-3)[2:], x[:-2])
