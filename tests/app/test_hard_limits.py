"""Hard limits hold whatever the model, the mode and the host say."""

from dataclasses import replace

import numpy as np
import pytest
from device_bench import AXIS_MODEL, UM, ZERO_V_CODE, Bench, V, model
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire

FREE = wire.AxisLimits(0, 65535, 2**32 - 1, 0, 65535)
VOLT = 3200
"""DAC codes."""
EIGHT_V = replace(FREE, dac_min=ZERO_V_CODE, dac_max=ZERO_V_CODE + 8 * VOLT)


def limits_set(x=FREE, y=FREE, z=FREE):
    return wire.LimitsSetRequest((x, y, z))


def limited(x, **bench):
    bench = Bench(**bench)
    bench.ok(limits_set(x))
    return bench


def test_without_a_record_the_converters_own_range_is_the_limit():
    reply = Bench().ok(wire.LimitsReadRequest())
    assert (reply.limits, reply.limits_lost) == ((FREE,) * 3, 0)


def test_they_survive_a_power_cycle_without_a_model():
    bench = limited(EIGHT_V)
    again = Bench(flash=bench.firmware.flash()[0])
    assert again.ok(wire.LimitsReadRequest()).limits == (EIGHT_V, FREE, FREE)
    again.set_axis()
    assert again.set_path(swing=9 * V) == wire.Status.OUTSIDE_LIMITS
    assert again.set_path(swing=2 * V, offset=-V) == wire.Status.OUTSIDE_LIMITS
    assert again.set_path(swing=8 * V) == wire.Status.OK


def test_a_model_that_asks_for_more_is_held_to_them():
    bench = limited(EIGHT_V)
    commit = bench.upload(model())  # -2..10 V
    assert (commit.status, commit.held_back) == (wire.Status.OK, 1)
    bench.set_axis()
    assert bench.set_path(swing=9 * V) == wire.Status.OUTSIDE_LIMITS
    assert bench.set_path(swing=8 * V) == wire.Status.OK


def test_a_tighter_model_stays_tighter():
    bench = limited(EIGHT_V)
    assert bench.upload(model(u_min_q24=0, u_max_q24=5 * V)).held_back == 0
    bench.set_axis()
    assert bench.set_path(swing=6 * V) == wire.Status.OUTSIDE_LIMITS


@pytest.mark.parametrize("factor", [0.5, 2, 5])
def test_another_calibration_of_the_converter_moves_nothing(factor):
    """A model that calls 2 V what is 1 V once had the whole converter to itself."""
    bench = limited(EIGHT_V)
    scaled = model(
        dac_codes_per_V_q16=round(AXIS_MODEL.dac_codes_per_V_q16 * factor),
        u_min_q24=round(-2 * V / factor),
        u_max_q24=round(10 * V / factor),
    )
    assert bench.upload(scaled).status == wire.Status.OK
    bench.set_axis()
    assert (
        bench.set_path(path=wire.PathKind.HOLD, swing=0, offset=round(8.01 * V / factor)) == wire.Status.OUTSIDE_LIMITS
    )
    assert bench.set_path(path=wire.PathKind.HOLD, swing=0, offset=round(7.99 * V / factor)) == wire.Status.OK
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StartRequest(1))
    bench.run(500)
    assert 0 <= ZERO_V_CODE + 8 * VOLT - int(bench.dac[-1, 0]) < VOLT // 50


@pytest.mark.parametrize("mode", [wire.Mode.OPEN, wire.Mode.PID, wire.Mode.FF_PID, wire.Mode.INVERSE_PID])
@settings(max_examples=8, deadline=None)
@given(
    low=st.integers(0, 4 * VOLT),
    high=st.integers(VOLT, 9 * VOLT),
    slew=st.integers(3 << 16, 400 << 16),
    code=st.integers(2000, 60_000),
)
def test_no_mode_drives_beyond_them_nor_faster(mode, low, high, slew, code):
    hard = replace(FREE, dac_min=ZERO_V_CODE - low, dac_max=ZERO_V_CODE + high, slew_codes_q16=slew)
    bench = limited(hard)
    assert bench.upload(model(u_min_q24=-10 * V, u_max_q24=10 * V, slew_q24=20 * V)).status == wire.Status.OK
    assert bench.set_axis(0, mode, **({} if mode == wire.Mode.OPEN else {"kp": V, "ki": 1 << 28})) == wire.Status.OK
    path = {"swing": high * V // VOLT, "step": 1 << 62} if mode == wire.Mode.OPEN else {"swing": 10 * UM}
    assert bench.set_path(**path) == wire.Status.OK
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StartRequest(1))
    bench.run(300, adc=code + np.arange(900).reshape(300, 3) % 5)
    codes = bench.dac[:, 0].astype(int)
    assert codes.min() >= hard.dac_min
    assert codes.max() <= hard.dac_max
    assert abs(np.diff(codes)).max() <= (slew >> 16) + 1


def test_a_set_point_outside_the_range_of_positions_is_refused():
    code = AXIS_MODEL.adc_zero_code + round(100 / 280 * 65536)
    bench = limited(replace(FREE, adc_max=code))
    bench.upload(model())
    for mode in (wire.Mode.PID, wire.Mode.FF_PID, wire.Mode.INVERSE):
        bench.set_axis(0, mode)
        assert bench.set_path(swing=101 * UM) == wire.Status.OUTSIDE_LIMITS, mode
        assert bench.set_path(swing=99 * UM) == wire.Status.OK, mode


@pytest.mark.parametrize("mode", [wire.Mode.OPEN, wire.Mode.PID])
def test_an_axis_that_leaves_its_range_of_positions_ramps_home(mode):
    bench = limited(replace(FREE, adc_max=30_000))
    bench.drive(mode=mode, **({"swing": 8 * V} if mode == wire.Mode.OPEN else {}))
    bench.run(50, adc=29_999)
    bench.run(2, adc=30_001)
    bench.run(5, adc=29_999)
    assert bench.state == wire.State.RUNNING  # two are a spike
    bench.run(3, adc=30_001)
    bench.run(1000, adc=29_000)
    status = bench.status()
    assert (status.fault, status.fault_axis) == (wire.Fault.POSITION_LIMIT, 0)
    assert bench.dac[-1, 0] == ZERO_V_CODE


def test_an_axis_that_does_not_move_may_be_anywhere():
    bench = Bench()
    bench.ok(limits_set(y=replace(FREE, adc_max=30_000)))
    bench.drive()
    bench.run(50, adc=40_000)
    assert bench.state == wire.State.RUNNING


def test_they_are_set_while_parked_alone():
    bench = Bench()
    bench.set_axis()
    bench.set_path()
    bench.ok(wire.ArmRequest(0))
    assert bench.status_of(limits_set(EIGHT_V)) == wire.Status.WRONG_STATE
    bench.ok(wire.StartRequest(1))
    assert bench.status_of(limits_set(EIGHT_V)) == wire.Status.WRONG_STATE
    bench.firmware.inject(wire.Fault.INTERLOCK)
    bench.run(2)
    assert bench.status_of(limits_set(EIGHT_V)) == wire.Status.FAULT_LATCHED
    assert bench.ok(wire.LimitsReadRequest()).limits == (FREE,) * 3


@pytest.mark.parametrize(
    ("bad", "status"),
    [
        (replace(FREE, dac_min=40_000, dac_max=39_000), wire.Status.BAD_VALUE),
        (replace(FREE, slew_codes_q16=0), wire.Status.BAD_VALUE),
        (replace(FREE, adc_min=5, adc_max=5), wire.Status.BAD_VALUE),
        (replace(FREE, dac_min=ZERO_V_CODE + 1), wire.Status.OUTSIDE_LIMITS),  # 0 V
        (replace(FREE, dac_max=ZERO_V_CODE - 1), wire.Status.OUTSIDE_LIMITS),
        (replace(FREE, dac_max=ZERO_V_CODE + VOLT), wire.Status.OUTSIDE_LIMITS),  # the safe value
    ],
)
def test_limits_that_cannot_be_met_change_nothing(bad, status):
    bench = Bench()
    bench.upload(model(u_park_q24=2 * V))
    writes = bench.firmware.flash()[1]
    assert bench.status_of(limits_set(bad)) == status
    assert bench.ok(wire.LimitsReadRequest()).limits == (FREE,) * 3
    assert bench.firmware.flash()[1] == writes


@pytest.mark.parametrize("bad", [{"dac_min": ZERO_V_CODE + 1}, {"dac_max": ZERO_V_CODE - 1}])
def test_limits_without_0_V_are_refused_where_0_V_is_the_safe_value(bad):
    assert Bench().status_of(limits_set(replace(FREE, **bad))) == wire.Status.OUTSIDE_LIMITS


def test_a_model_whose_safe_value_is_outside_is_refused():
    bench = limited(EIGHT_V)
    assert bench.upload(model(u_park_q24=9 * V)).status == wire.Status.OUTSIDE_LIMITS
    assert bench.upload(model(u_park_q24=7 * V)).status == wire.Status.OK


def test_a_persisted_model_that_came_before_them_is_not_armed():
    bench = Bench()
    bench.upload(model(u_park_q24=9 * V))
    bench.ok(wire.ModelPersistRequest())
    bench.upload(model(hash_byte=1))
    bench.ok(limits_set(EIGHT_V))
    bench = Bench(flash=bench.firmware.flash()[0])
    assert bench.status_of(wire.ArmRequest(0)) == wire.Status.OUTSIDE_LIMITS
    bench.run(10)
    assert (bench.dac == ZERO_V_CODE).all()


def test_setting_them_drops_modes_and_paths():
    bench = Bench()
    bench.set_axis()
    bench.set_path(swing=9 * V)
    bench.ok(limits_set(EIGHT_V))
    bench.ok(wire.ArmRequest(0))
    assert bench.status_of(wire.StartRequest(1)) == wire.Status.BAD_VALUE
