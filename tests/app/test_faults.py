"""Each fault is injected into a moving device: its reaction begins within one tick and never outruns the limits."""

import numpy as np
import pytest
from device_bench import MID_CODE, RAMP_CODES, SLEW_CODES, UM, ZERO_V_CODE, Bench, V, model

from phaselead.device import wire

RAMPING = [
    wire.Fault.TICK_OVERRUN,
    wire.Fault.CONVERTER_SILENT,
    wire.Fault.INTERLOCK,
]
HOLDING = [wire.Fault.FLASH_ERROR, wire.Fault.TRACKING_ERROR]


@pytest.fixture
def moving():
    bench = Bench()
    bench.drive(swing=8 * V)
    bench.run(300)  # on the way up, far from the safe value
    return bench


def steps(codes):
    return np.diff(codes[:, 0].astype(int))


def assert_ramps_home(bench, from_code, codes):
    """Downwards at the ramp from the first tick on, never faster, until the safe value."""
    way = np.concatenate([[from_code], codes[:, 0].astype(int)])
    moves = np.diff(way)
    arrived = np.flatnonzero(way == ZERO_V_CODE)[0]
    assert moves[: arrived - 1].min() >= -RAMP_CODES - 1
    assert moves[: arrived - 1].max() <= -RAMP_CODES + 1
    assert not moves[arrived:].any()


@pytest.mark.parametrize("fault", RAMPING)
def test_a_raised_fault_ramps_home_from_the_next_tick(moving, fault):
    moving.firmware.inject(fault, 1)
    assert_ramps_home(moving, int(moving.dac[-1, 0]), moving.run(1000))
    status = moving.status()
    assert (status.state, status.fault, status.fault_axis) == (wire.State.FAULT, fault, 1)
    assert [event.value for event in moving.events if event.kind == wire.EventKind.FAULT] == [fault]


@pytest.mark.parametrize("fault", HOLDING)
def test_a_holding_fault_keeps_the_output_until_it_is_parked(moving, fault):
    moving.firmware.inject(fault)
    before = int(moving.dac[-1, 0])
    assert (moving.run(500)[:, 0] == before).all()
    assert moving.status().fault == fault
    assert moving.status_of(wire.ClearFaultRequest()) == wire.Status.WRONG_STATE
    before = int(moving.dac[-1, 0])
    moving.ok(wire.ParkRequest())
    assert_ramps_home(moving, before, np.concatenate([moving.dac[-1:], moving.run(1000)]))
    assert moving.state == wire.State.FAULT
    moving.ok(wire.ClearFaultRequest())
    assert moving.state == wire.State.PARKED


@pytest.mark.parametrize("rail", [0, 65535])
def test_three_samples_at_a_rail_end_a_closed_loop(rail):
    near = abs(rail - 10_000)
    bench = Bench()
    bench.drive(mode=wire.Mode.PID)
    bench.run(50, adc=near)
    bench.run(2, adc=rail)
    bench.run(10, adc=near)
    assert not [event for event in bench.events if event.kind == wire.EventKind.FAULT]  # two are no clip
    bench.run(3, adc=rail)
    before = int(bench.dac[-1, 0])
    codes = bench.run(1000, adc=near)
    moves = np.diff(np.concatenate([[before], codes[:, 0].astype(int)]))
    assert moves[0] != 0 or before == ZERO_V_CODE
    assert abs(moves).max() <= RAMP_CODES + 1
    assert codes[-1, 0] == ZERO_V_CODE
    status = bench.status()
    assert (status.fault, status.fault_axis) == (wire.Fault.ADC_RAIL, 0)


def closed_loop(mode=wire.Mode.PID, **path):
    """A device whose axis x follows a path; its sensor shows noise of one code."""
    bench = Bench()
    bench.drive(mode=mode, **path)
    return bench


def noisy(ticks, at=20_000):
    codes = np.full((ticks, 3), at)
    codes[1::2] += 1
    return codes


def test_a_frozen_sensor_ramps_home():
    bench = closed_loop(offset=45 * UM)
    bench.run(500, adc=noisy(500))
    codes = bench.run(1500, adc=20_001)[:, 0].astype(int)
    status = bench.status()
    assert (status.fault, status.fault_axis) == (wire.Fault.SENSOR_FROZEN, 0)
    assert codes[-1] == ZERO_V_CODE
    assert codes.max() < ZERO_V_CODE + 6 * 3200  # it once drove on to the limit


def test_a_jumping_sensor_ramps_home():
    bench = closed_loop()
    jumps = noisy(200)
    jumps[50::10] += 20_000
    bench.run(200, adc=jumps)
    status = bench.status()
    assert (status.fault, status.fault_axis) == (wire.Fault.SENSOR_JUMP, 0)
    assert status.fault_tick - 50 < 30


WITHOUT_FEEDBACK = (wire.Mode.OPEN, wire.Mode.FF, wire.Mode.INVERSE)


def without_feedback(mode, ticks_per_V=50):
    """Axis 1 goes up by a volt in ``ticks_per_V``."""
    bench = Bench()
    assert bench.upload(model()).status == wire.Status.OK
    swing = 8 * V if mode == wire.Mode.OPEN else 100 * UM
    assert bench.set_axis(1, mode) == wire.Status.OK
    kind = wire.PathKind.SINE if mode == wire.Mode.FF else wire.PathKind.MOVE
    assert bench.set_path(1, path=kind, swing=swing, step=2**64 // (8 * ticks_per_V)) == wire.Status.OK
    bench.ok(wire.SetTimeoutRequest(0))
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StartRequest(2))
    return bench


@pytest.mark.parametrize("mode", WITHOUT_FEEDBACK)
def test_a_frozen_sensor_is_noticed_without_feedback_too(mode):
    bench = without_feedback(mode)
    bench.run(60)
    codes = bench.run(1500, adc=20_001)[:, 1]
    status = bench.status()
    assert (status.fault, status.fault_axis) == (wire.Fault.SENSOR_FROZEN, 1)
    assert 100 <= status.fault_tick - (len(bench.dac) - 1501) <= 110
    assert codes[-1] == ZERO_V_CODE


@pytest.mark.parametrize("mode", WITHOUT_FEEDBACK)
def test_a_jumping_sensor_is_noticed_without_feedback_too(mode):
    bench = without_feedback(mode)
    jumps = noisy(200)
    jumps[50:100:20] += 20_000
    bench.run(200, adc=jumps)
    status = bench.status()
    assert (status.fault, status.fault_axis) == (wire.Fault.SENSOR_JUMP, 1)


@pytest.mark.parametrize("mode", WITHOUT_FEEDBACK)
def test_without_feedback_neither_an_error_nor_a_limit_nor_a_spike_is_a_fault(mode):
    """Nothing holds the position to the path, nor the output within the slew limit."""
    bench = without_feedback(mode, ticks_per_V=4 if mode != wire.Mode.FF else 40)  # tables end at 20 Hz
    codes = noisy(4000)
    codes[50:3000:60] += 20_000  # a jump there and one back, and calm before the next
    bench.run(4000, adc=codes)
    assert bench.status().fault == wire.Fault.NONE


@pytest.mark.parametrize("still", [MID_CODE, 65535])
def test_a_code_that_stays_is_no_fault_where_the_output_does_or_where_the_sensor_ends(still):
    slow = without_feedback(wire.Mode.OPEN, ticks_per_V=10_000)
    slow.run(2000, adc=still)
    assert slow.state == wire.State.RUNNING
    fast = without_feedback(wire.Mode.OPEN)
    fast.run(300, adc=still)
    assert fast.state == (wire.State.RUNNING if still == 65535 else wire.State.FAULT)


def test_an_error_that_stays_is_a_fault_and_holds():
    """The plant is gone: the sensor shows noise and nothing else."""
    bench = Bench()
    bench.upload(model(error_limit_q16=20 * UM, error_ticks=300))
    bench.drive(mode=wire.Mode.PID, path=wire.PathKind.MOVE, swing=40 * UM, offset=75 * UM, step=2**64 // 500)
    bench.run(1500, adc=noisy(1500))
    status = bench.status()
    assert (status.fault, status.fault_axis) == (wire.Fault.TRACKING_ERROR, 0)
    held = bench.run(300, adc=noisy(300))[:, 0]
    assert len(set(held)) == 1


@pytest.mark.parametrize("with_model", [True, False])
def test_without_a_limit_in_the_model_a_quarter_of_the_sensor_counts(with_model):
    for swing_um, fault in ((60, wire.Fault.NONE), (120, wire.Fault.TRACKING_ERROR)):
        bench = Bench()
        if with_model:
            assert bench.upload(model(error_limit_q16=0, error_ticks=0)).status == wire.Status.OK
        bench.set_axis(0, wire.Mode.PID, kp=1)
        assert bench.set_path(path=wire.PathKind.MOVE, swing=swing_um << 16, offset=75 << 16, step=2**64 // 500) == 0
        bench.ok(wire.SetTimeoutRequest(0))
        bench.ok(wire.ArmRequest(0))
        bench.ok(wire.StartRequest(1))
        bench.run(2000, adc=noisy(2000))
        assert bench.status().fault == fault


def test_a_loop_that_is_at_its_limit_for_half_a_second_ramps_home():
    bench = Bench()
    bench.set_axis(0, wire.Mode.PID, ki=1 << 20)
    assert bench.set_path(path=wire.PathKind.HOLD, swing=0, offset=140 << 16) == 0
    bench.ok(wire.SetTimeoutRequest(0))
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StartRequest(1))
    bench.run(3000, adc=noisy(3000))  # at 10 V after some 640
    assert bench.state == wire.State.RUNNING
    codes = bench.run(2000, adc=noisy(2000))
    assert bench.status().fault == wire.Fault.OUTPUT_LIMITED
    assert codes[-1, 0] == ZERO_V_CODE


def test_rails_do_not_matter_to_an_open_loop_or_to_other_axes(moving):
    moving.run(100, adc=[65535, 0, 65535])
    moving.run(3000, adc=noisy(3000)[:, ::-1] * [1, 3, 1])
    moving.ok(wire.StatusRequest())
    assert moving.state == wire.State.RUNNING


def test_a_silent_host_ramps_to_park_and_latches(moving):
    moving.ok(wire.SetTimeoutRequest(200))
    codes = moving.run(199 + 1000)
    assert moving.status().fault == wire.Fault.HOST_TIMEOUT
    # The command took effect one tick before the last one was run by asking for it.
    running = codes[:198]
    assert (steps(running) != -RAMP_CODES).any()
    assert_ramps_home(moving, int(codes[198, 0]), codes[199:])


def test_a_host_that_speaks_in_time_is_no_fault(moving):
    moving.ok(wire.SetTimeoutRequest(50))
    for _ in range(20):
        moving.run(40)
        assert moving.state == wire.State.RUNNING


def test_no_timeout_when_it_is_switched_off(moving):
    moving.ok(wire.SetTimeoutRequest(0))
    moving.run(50_000)
    assert moving.state == wire.State.RUNNING


def test_a_lost_core_comes_back_at_zero_with_the_fault_latched(moving):
    moving.firmware.inject(wire.Fault.CORE_LOST)
    assert (moving.run(100)[:, 0] == ZERO_V_CODE).all()
    assert moving.status_of(wire.StatusRequest()) == wire.Status.NO_SESSION
    hello = moving.ok(wire.HelloRequest())
    assert hello.reset_cause == wire.ResetCause.WATCHDOG
    assert moving.status().fault == wire.Fault.CORE_LOST
    assert moving.status_of(wire.ArmRequest(0)) == wire.Status.FAULT_LATCHED
    moving.ok(wire.ClearFaultRequest())
    assert moving.state == wire.State.PARKED


@pytest.mark.parametrize("fault", [*RAMPING, *HOLDING, wire.Fault.HOST_TIMEOUT])
def test_a_latched_fault_bars_everything_that_moves(moving, fault):
    moving.firmware.inject(fault)
    moving.run(1)
    for command in (
        wire.ArmRequest(0),
        wire.StartRequest(1),
        wire.SetAxisRequest(0, wire.Mode.OPEN, 0, 0, 0, 1),
        wire.SetPathRequest(0, wire.PathKind.HOLD, 0, 0, 0, 0),
        wire.ModelBeginRequest(wire.Model.SIZE, 0),
    ):
        assert moving.status_of(command) == wire.Status.FAULT_LATCHED


def test_the_first_fault_stays_when_others_follow(moving):
    moving.firmware.inject(wire.Fault.TRACKING_ERROR, 2)
    moving.run(5)
    moving.firmware.inject(wire.Fault.INTERLOCK, 1)
    held = int(moving.dac[-1, 0])
    assert_ramps_home(moving, held, moving.run(1000))  # a ramp overrules the hold ...
    status = moving.status()
    assert (status.fault, status.fault_axis) == (wire.Fault.TRACKING_ERROR, 2)  # ... but not the cause


@pytest.mark.parametrize("first", [0, 1])
def test_of_two_faults_of_one_tick_the_first_is_kept_with_its_axis(moving, first):
    """The second once gave its axis and detail to both, and a lower number won: a crash with a dead DAC was lost."""
    faults = [(wire.Fault.INTERLOCK, 1), (wire.Fault.CONVERTER_SILENT, 2)]
    for fault, axis in (faults[first], faults[1 - first]):
        moving.firmware.inject(fault, axis)
    moving.run(1)
    status = moving.status()
    assert (status.fault, status.fault_axis) == faults[first]


def test_a_fault_freezes_the_recorder_after_its_post_trigger(moving):
    start = moving.ok(wire.StreamStartRequest(wire.Channel.DAC, 1, 1))
    moving.run(100)
    moving.firmware.inject(wire.Fault.INTERLOCK)
    moving.run(3000)
    fault_tick = moving.status().fault_tick
    stop = moving.ok(wire.StreamStopRequest())
    assert start.tick + stop.sent_ticks == fault_tick + 250
    assert stop.dropped_ticks == 0
    sent = b"".join(batch.data for batch in moving.samples)
    assert np.array_equal(np.frombuffer(sent, "<u2"), moving.dac[start.tick : fault_tick + 250, 0])


def test_the_output_never_outruns_its_slew_whatever_happens():
    bench = Bench()
    bench.drive(path=wire.PathKind.SINE, swing=12 * V, offset=-2 * V, step=1 << 62)  # far too fast
    bench.run(500)
    bench.firmware.inject(wire.Fault.INTERLOCK)
    bench.run(500)
    assert abs(np.diff(bench.dac[:, 0].astype(int))).max() <= SLEW_CODES
