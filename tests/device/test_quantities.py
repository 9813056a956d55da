"""Gains and paths arrive as what was asked for, or are refused with the figure."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.device import wire
from phaselead.device.encode_compensation import NO_COMPENSATION
from phaselead.device.quantities import (
    UNFILTERED_Q31,
    axis_request,
    converters,
    derivative_alpha_q31,
    path_request,
    to_i32,
    wave_points,
)
from phaselead.errors import BadInput


@given(value=st.floats(-127.9, 127.9), bits=st.integers(0, 24))
def test_rounding_is_within_half_a_step_or_refused(value: float, bits: int) -> None:
    try:
        got = to_i32(value, bits, "Kp", "V/um")
    except BadInput:
        assert 0 < abs(value) <= 2.0 ** -(bits + 1)
        return
    assert abs(got / 2**bits - value) <= 2.0 ** -(bits + 1)


@pytest.mark.parametrize(
    ("gains", "message"),
    [
        ((128.0, 0, 0), r"Kp = 128 V/um does not fit its format: at most 127\.99999994\d* V/um"),
        ((0, 2500.0, 0), r"Ki = 2500 V/\(um s\) does not fit its format: at most 2499\.9999988\d* V/\(um s\)"),
        ((0, 0, 0.0257), r"Kd = 0\.0257 V s/um does not fit its format: at most 0\.02559999998\d* V s/um"),
        ((1e-9, 0, 0), r"Kp = 1e-09 V/um is too small for its format: its step is 5\.96046e-08 V/um"),
        ((0, 1e-7, 0), r"Ki = 1e-07 .* the smallest step is 1\.16e-06 V/\(um s\)"),
        ((0, 0, 1e-13), r"Kd = 1e-13 .* the smallest step is 1\.19e-11 V s/um"),
        ((math.nan, 0, 0), "Kp = nan V/um is no number"),
        ((0, math.inf, 0), "Ki = inf .* is no number"),
    ],
)
def test_a_gain_that_does_not_fit_is_refused_with_the_figure(gains: tuple[float, ...], message: str) -> None:
    with pytest.raises(BadInput, match=message):
        axis_request(0, wire.Mode.PID, *gains, None)


def test_gains_travel_as_kp_ki_ts_kd_over_ts() -> None:
    request = axis_request(1, wire.Mode.PID, 0.004, 1.67, 2.39e-6, None)
    assert request.kp_q24 == round(0.004 * 2**24)
    assert request.ki_ts_q32 == round(1.67 / 5000 * 2**32)
    assert request.kd_over_ts_q24 == round(2.39e-6 * 5000 * 2**24)
    assert request.d_alpha_q31 == UNFILTERED_Q31


@given(f_Hz=st.floats(0.1, 1e6))
def test_derivative_filter_has_its_corner(f_Hz: float) -> None:
    alpha = derivative_alpha_q31(f_Hz) / 2**31
    assert 0 < alpha < 1
    if 1 < f_Hz < 5_000:
        assert -math.log1p(-alpha) * 5000 / (2 * math.pi) == pytest.approx(f_Hz, rel=1e-5)


def test_derivative_filter_of_nothing_is_refused() -> None:
    for f_Hz in (0.0, -1.0, math.nan):
        with pytest.raises(BadInput):
            derivative_alpha_q31(f_Hz)


@given(f_Hz=st.floats(1e-3, 2499.9))
def test_frequency_is_exact_to_less_than_a_millionth_of_a_turn_a_day(f_Hz: float) -> None:
    request = path_request(0, wire.PathKind.SINE, 60.0, 0.0, f_Hz, 0, False)
    drift_turns = abs(request.step_turn64 / 2**64 * 5000 - f_Hz) * 86400
    assert drift_turns < 1e-6 * max(f_Hz, 1)


def test_units_of_a_path_follow_the_mode() -> None:
    um = path_request(0, wire.PathKind.SINE, 60.0, 20.0, 5.0, 0, False)
    assert (um.swing, um.offset) == (60 * 2**16, 20 * 2**16)
    volts = path_request(0, wire.PathKind.SINE, 5.0, -2.0, 5.0, 0, True)
    assert (volts.swing, volts.offset) == (5 * 2**24, -2 * 2**24)


@given(ticks=st.integers(1, 10**7))
def test_a_move_arrives_in_its_last_tick(ticks: int) -> None:
    step = path_request(0, wire.PathKind.MOVE, -10.0, 20.0, 0.0, ticks, False).step_turn64
    assert step * (ticks - 1) < 2**64
    assert step * ticks >= 2**64 - 1


@pytest.mark.parametrize(
    ("kind", "swing", "f_Hz", "ticks", "message"),
    [
        (wire.PathKind.SINE, 60.0, 2500.0, 0, "below 2500 Hz"),
        (wire.PathKind.SINE, 60.0, 0.0, 0, "above 0"),
        (wire.PathKind.WAVE, 60.0, math.nan, 0, "above 0"),
        (
            wire.PathKind.SINE,
            40000.0,
            5.0,
            0,
            r"swing = 40000 um does not fit its format: at most 32767\.9999847 um, 1\.22 x",
        ),
        (wire.PathKind.MOVE, 60.0, 0.0, 0, "needs a duration"),
        (wire.PathKind.HOLD, 0.0, 0.0, -1, "between 0"),
        (wire.PathKind.HOLD, 0.0, 0.0, 2**64, "between 0"),
    ],
)
def test_a_path_that_cannot_travel_is_refused(
    kind: wire.PathKind, swing: float, f_Hz: float, ticks: int, message: str
) -> None:
    with pytest.raises(BadInput, match=message):
        path_request(0, kind, swing, 0.0, f_Hz, ticks, False)


def test_wave_points() -> None:
    data = wave_points(np.linspace(0, 1, 1024))
    points = np.frombuffer(data, "<i4")
    assert (points[0], points[-1]) == (0, 2**30)
    for bad in (np.zeros(1000), np.full(1024, 1.001), np.full(1024, np.nan)):
        with pytest.raises(BadInput):
            wave_points(bad)


def test_converters_of_a_model_and_without() -> None:
    zeros = {name: 0 for name in (field.name for field in fields(wire.AxisModel))}
    arrays = {"a_q32": (0,) * 3, "b_q40": (0,) * 6, "c_q32": (0,) * 6, "coupling_q28": (0,) * 3, **NO_COMPENSATION}
    scales = {
        "dac_zero_code": 100,
        "dac_codes_per_V_q16": 50 * 2**16,
        "adc_zero_code": 7,
        "adc_um_per_code_q32": 2**30,
    }
    axis = wire.AxisModel(**(zeros | arrays | scales))  # type: ignore[arg-type]
    got = converters(wire.Model(0, bytes(32), (axis,) * 3).pack())["y"]
    assert got.u_V(np.array([100, 150], np.uint16)).tolist() == [0.0, 1.0]
    assert got.x_um(np.array([7, 11], np.uint16)).tolist() == [0.0, 1.0]
    between = replace(axis, flags=3 | 64 << 24)
    got = converters(wire.Model(0, bytes(32), (between,) * 3).pack())["y"]
    assert got.x_um(np.array([7, 11], np.uint16)).tolist() == [-0.0625, 0.9375]
    default = converters(None)["x"]
    assert default.u_V(np.array([32768, 0], np.uint16)).tolist() == [0.0, -10.24]
    assert abs(default.x_um(np.array([0], np.uint16))[0] + 10) < 1e-5


@given(st.floats(-7e-6, 7e-6), st.floats(-7e-6, 7e-6))
def test_a_way_of_less_than_the_device_can_tell_is_none(swing_um, offset_um):
    """A held axis stands within a rounding of its target."""
    made = path_request(0, wire.PathKind.MOVE, swing_um, offset_um, 0.0, 100, volts=False)
    assert (made.swing, made.offset) == (0, 0)
    with pytest.raises(BadInput, match="too small for its format"):
        path_request(0, wire.PathKind.SINE, 7e-6, 0.0, 5.0, 0, volts=False)
