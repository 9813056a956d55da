"""Laws of the play operator, and the kernel against plain Python."""

from __future__ import annotations

import ctypes
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from phaselead.compiled import kernel_of
from phaselead.errors import PhaseleadError
from phaselead.model.axis import TimeView
from phaselead.model.operator import (
    delayed,
    plays,
    predict_time_view,
    respond,
    rest_plays,
    rest_position_um,
)
from phaselead.model.stage_file import parse_stage

volts = st.floats(-10, 10, allow_subnormal=False).map(lambda v: round(v, 6))
voltages = st.integers(1, 60).flatmap(lambda n: arrays(np.float64, n, elements=volts))
thresholds = st.lists(st.floats(0, 8).map(lambda v: round(v, 6)), min_size=0, max_size=9, unique=True).map(sorted)
laws = settings(max_examples=60, deadline=None)


def slow_plays(v: list[float], r: list[float], p: list[float]) -> list[list[float]]:
    found = []
    for volt in v:
        p = [max(volt - a, min(volt + a, b)) for a, b in zip(r, p, strict=True)]
        found.append(p)
    return found


def field_V(view: TimeView, u: np.ndarray) -> np.ndarray:
    """The parabola inside the fitted voltages, its tangents beyond them; 0 V at 0 V."""
    (low, high), b = view.u_range_V, view.field_bend
    half, middle = (high - low) / 2, (high + low) / 2

    def bent(v: np.ndarray) -> np.ndarray:
        inside = v + b / half * (v - middle) ** 2
        left, right = low + b * half + (1 - 2 * b) * (v - low), high + b * half + (1 + 2 * b) * (v - high)
        return np.where(v < low, left, np.where(v > high, right, inside))

    return bent(np.asarray(u)) - bent(np.zeros(()))


def read_V(view: TimeView, p: np.ndarray) -> np.ndarray:
    """The integral of 1 + tilt s - taper s^2 from 0 V on, its tangents beyond the field of the fitted voltages."""
    low, high = field_V(view, np.array(view.u_range_V))
    half, middle, a, b = (high - low) / 2, (high + low) / 2, view.play_tilt, view.play_taper

    def below(v: np.ndarray) -> np.ndarray:
        s = (v - middle) / half
        left, right = -1 + a / 2 + b / 3 + (1 - a - b) * (s + 1), 1 + a / 2 - b / 3 + (1 + a - b) * (s - 1)
        return half * np.where(s < -1, left, np.where(s > 1, right, s + a * s**2 / 2 - b * s**3 / 3))

    return below(np.asarray(p)) - below(np.zeros(()))


@st.composite
def views(draw: st.DrawFn) -> TimeView:
    r = draw(thresholds)
    d = draw(st.lists(volts, max_size=4, unique=True).map(sorted))
    share = st.floats(-3, 3)
    return TimeView(
        gain_um_per_V=draw(share),
        play_r_V=tuple(r),
        play_w_um_per_V=tuple(draw(st.floats(0, 3)) for _ in r),
        deadzone_d_V=tuple(d),
        deadzone_s_um_per_V=tuple(draw(share) for _ in d),
        offset_um=draw(st.floats(-200, 200)),
        delay_s=draw(st.floats(0, 0.02)),
        rest_fraction=draw(st.floats(-1, 1)),
        field_bend=draw(st.sampled_from([0.0, 0.0, 0.2, -0.1])),
        play_tilt=draw(st.sampled_from([0.0, 0.0, 0.4, -0.3])),
        play_taper=draw(st.sampled_from([0.0, 0.0, 0.4, -0.2])),
        u_range_V=draw(st.sampled_from([(-10.0, 10.0), (0.0, 8.0), (2.0, 9.0)])),
        rate_Hz=200.0,
    )


@laws
@given(voltages, thresholds, st.floats(-1, 1))
def test_kernel_equals_plain_python(v, r, rest):
    start = [rest * a for a in r]
    found, end = plays(v, r, start)
    expected = np.array(slow_plays(v.tolist(), r, start)).reshape(len(v), len(r))
    assert np.array_equal(found, expected)
    assert np.array_equal(end, expected[-1])


@laws
@given(voltages, thresholds, st.data())
def test_chosen_rows_are_the_rows(v, r, data):
    rows = sorted(data.draw(st.sets(st.integers(0, len(v) - 1))))
    whole, end = plays(v, r, np.zeros(len(r)))
    some, same_end = plays(v, r, np.zeros(len(r)), np.array(rows, dtype=np.uintp))
    assert np.array_equal(some, whole[rows])
    assert np.array_equal(same_end, end)


@laws
@given(voltages, thresholds)
def test_never_further_from_the_input_than_its_threshold(v, r):
    found, _ = plays(v, r, np.zeros(len(r)))
    assert np.all(np.abs(found - v[:, None]) <= np.array(r) + 1e-9)


@laws
@given(voltages, thresholds, st.integers(1, 7))
def test_rate_independence(v, r, between):
    """Going the same way in smaller steps ends in the same place."""
    at = np.arange((len(v) - 1) * between + 1) / between
    fine = np.interp(at, np.arange(len(v)), v)
    fine[::between] = v
    coarse, _ = plays(v, r, np.zeros(len(r)))
    finer, _ = plays(fine, r, np.zeros(len(r)))
    assert np.allclose(finer[::between], coarse, atol=1e-12)


@laws
@given(voltages, voltages, st.lists(st.floats(0.01, 7.9), min_size=1, max_size=6))
def test_wiping_out(past, other_past, r):
    """An excursion past everything before forgets it."""
    wipe = np.array([10.0 + 8, -10.0 - 8])
    a, _ = plays(np.concatenate([past, wipe]), r, np.zeros(len(r)))
    b, _ = plays(np.concatenate([other_past, wipe]), r, np.zeros(len(r)))
    assert np.array_equal(a[-1], b[-1])


@laws
@given(voltages, voltages, volts, volts, thresholds)
def test_congruency(past, other_past, low, high, r):
    """Minor loops between the same two voltages have the same shape, whatever came before."""
    loop = np.concatenate([np.linspace(high, low, 9), np.linspace(low, high, 9)])
    shapes = []
    for history in (past, other_past):
        found, _ = plays(np.concatenate([history, loop, loop]), r, np.zeros(len(r)))
        shapes.append(found[-len(loop) :] - found[-len(loop)])
    assert np.allclose(shapes[0], shapes[1], atol=1e-9)


@laws
@given(voltages, thresholds, st.data())
def test_order_is_preserved(v, r, data):
    more = v + data.draw(arrays(np.float64, len(v), elements=st.floats(0, 3)))
    below, _ = plays(v, r, np.zeros(len(r)))
    above, _ = plays(more, r, np.zeros(len(r)))
    assert np.all(below <= above)


@laws
@given(voltages, views(), st.integers(0, 60))
def test_a_record_can_be_continued(v, view, cut):
    cut = min(cut, len(v))
    whole, end = respond(view, v, rest_plays(view))
    first, middle = respond(view, v[:cut], rest_plays(view))
    second, same_end = respond(view, v[cut:], middle)
    assert np.allclose(np.concatenate([first, second]), whole, rtol=0, atol=1e-12)
    assert np.allclose(same_end, end, rtol=0, atol=1e-12)


@laws
@given(voltages, views(), st.data())
def test_plays_that_move_in_turn_add_up(v, view, data):
    """From any start, in touch with each other or not."""
    start = np.array([data.draw(volts) for _ in view.play_r_V])
    found, same_end = respond(view, v, start)
    v = field_V(view, v)
    each, end = plays(v, view.play_r_V, start)
    beyond = np.maximum(v[:, None] - np.array(view.deadzone_d_V), 0.0) @ np.array(view.deadzone_s_um_per_V)
    added = view.offset_um + view.gain_um_per_V * v + read_V(view, each) @ np.array(view.play_w_um_per_V) + beyond
    assert np.allclose(found, added, rtol=0, atol=1e-9)
    assert np.allclose(same_end, end, rtol=0, atol=1e-12)


@laws
@given(voltages, st.floats(0, 80), volts)
def test_delay_is_linear_interpolation(u, samples, before):
    rows = np.arange(-100, len(u))
    held = np.concatenate([np.full(100, before), u])
    expected = np.interp(np.arange(len(u)) - samples, rows, held)
    assert np.allclose(delayed(u, samples, before), expected, atol=1e-9)


@laws
@given(voltages, views())
def test_prediction_equals_the_formula(u, view):
    t = 3.0 + np.arange(len(u)) / view.rate_Hz
    step = (t[-1] - t[0]) / (len(t) - 1) if len(t) > 1 else 1.0
    v = field_V(view, delayed(u, view.delay_s / step))
    p = np.array(slow_plays(v.tolist(), list(view.play_r_V), rest_plays(view).tolist())).reshape(len(v), -1)
    x = view.offset_um + view.gain_um_per_V * v + read_V(view, p) @ np.array(view.play_w_um_per_V)
    for d, s in zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True):
        x = x + s * np.maximum(v - d, 0)
    assert np.allclose(predict_time_view(view, t, u), x, atol=1e-9)


@laws
@given(views(), st.integers(2, 20))
def test_rest_stays_at_rest(view, n):
    x = predict_time_view(view, np.arange(n) / 100.0, np.zeros(n))
    assert np.allclose(x, rest_position_um(view), atol=1e-9)


def test_before_the_first_row_is_rest():
    view = TimeView(gain_um_per_V=1.0, delay_s=0.015, u_range_V=(0.0, 2.0), rate_Hz=100.0, offset_um=-7.0)
    t, u = np.arange(5) / 100, np.full(5, 2.0)
    assert predict_time_view(view, t, u) == pytest.approx([-7, -6, -5, -5, -5])
    assert predict_time_view(view, t, u, initial_plays_V=[]) == pytest.approx([-5] * 5)


def test_the_built_in_stage_reads_zero_at_rest():
    text = files("phaselead.sim").joinpath("xyz250.toml").read_text()
    for axis in parse_stage(text).axes.values():
        assert axis.time is not None
        assert abs(rest_position_um(axis.time)) < 1e-6


def test_refuses_what_it_cannot_do():
    with pytest.raises(ValueError, match="future"):
        delayed([1.0], -0.1)
    with pytest.raises(ValueError, match="starting positions"):
        plays([1.0], [1.0, 2.0], [0.0])
    view = TimeView(gain_um_per_V=1.0, u_range_V=(0.0, 1.0), rate_Hz=1.0)
    with pytest.raises(ValueError, match="0 plays need as many starting positions"):
        respond(view, [1.0], [0.0])


class Other(ctypes.Structure):
    """What no build has."""

    _fields_ = (("gain", ctypes.c_double),)


@pytest.mark.parametrize("name", ["stage_operator_size", "stage_basis_size", "stage_unknown_size"])
def test_a_library_with_other_structures_is_refused(name):
    """One from before they grew read what stood elsewhere, and gave wrong positions."""
    with pytest.raises(PhaseleadError, match="older build; run"):
        kernel_of("phaselead.model._kernel", sizes={name: Other})
