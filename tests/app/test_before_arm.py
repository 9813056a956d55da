"""Nothing moves before ARM, whatever the model says, and a new session starts clean."""

from zlib import crc32

import numpy as np
import pytest
from device_bench import SESSION, UM, Bench, V, model

from phaselead.device import wire

ZERO_V = 32768
OTHER = 0x0BAD_CAFE_0000_0001
PARKED_AT_1V = ZERO_V + 3200
DETECTED = [wire.Fault.INTERLOCK, wire.Fault.CONVERTER_SILENT, wire.Fault.TICK_OVERRUN, wire.Fault.FLASH_ERROR]


def saved(u_park):
    """A flash image with a model that parks elsewhere."""
    bench = Bench()
    bench.upload(model(u_park_q24=u_park))
    bench.ok(wire.ModelPersistRequest())
    return bench.firmware.flash()[0]


@pytest.fixture(params=[-V, V, 5 * V])
def off_zero(request):
    """A device just switched on, its model in flash parking off 0 V; no host has spoken."""
    return Bench(flash=saved(request.param), hello=False)


def assert_still(bench, ticks=2000):
    assert np.all(bench.run(ticks) == ZERO_V)


def test_it_stays_at_0_V_after_power_on(off_zero):
    assert_still(off_zero)
    off_zero.ok(wire.HelloRequest())
    assert_still(off_zero)


def test_stop_without_a_session_moves_nothing(off_zero):
    off_zero.ok(wire.StopRequest())
    assert_still(off_zero)


@pytest.mark.parametrize("fault", DETECTED)
def test_a_fault_at_boot_moves_nothing_nor_does_clearing_it(off_zero, fault):
    off_zero.firmware.inject(fault)
    assert_still(off_zero)
    off_zero.ok(wire.HelloRequest())
    off_zero.ok(wire.ParkRequest())
    off_zero.ok(wire.ClearFaultRequest())
    assert_still(off_zero)
    assert off_zero.state == wire.State.PARKED


def test_a_lost_core_leaves_it_at_0_V(off_zero):
    off_zero.firmware.inject(wire.Fault.CORE_LOST)
    assert_still(off_zero)


def test_park_before_arm_moves_nothing_and_arm_goes_to_the_safe_value():
    bench = Bench()
    bench.upload(model(u_park_q24=V))
    bench.ok(wire.ParkRequest())
    assert_still(bench)
    assert bench.status().at_rest == 7
    bench.ok(wire.ArmRequest(0))
    codes = bench.run(300)[:, 0].astype(int)
    assert codes[-1] == PARKED_AT_1V
    assert np.abs(np.diff(codes)).max() <= 33
    bench.ok(wire.ParkRequest())
    assert bench.run(300)[-1, 0] == PARKED_AT_1V


@pytest.fixture
def parked_at_1V():
    bench = Bench()
    bench.upload(model(u_park_q24=V))
    bench.ok(wire.ArmRequest(0))
    bench.run(300)
    bench.park()
    assert bench.dac[-1, 0] == PARKED_AT_1V
    return bench


@pytest.mark.parametrize("command", [wire.StopRequest(), wire.ParkRequest()])
def test_with_another_safe_value_a_parked_output_holds_until_it_is_armed(parked_at_1V, command):
    bench = parked_at_1V
    assert bench.upload(model(u_park_q24=3 * V)).status == wire.Status.OK
    bench.ok(command)
    assert np.all(bench.run(500)[:, 0] == PARKED_AT_1V)
    assert bench.status().at_rest == 7
    bench.ok(wire.ArmRequest(0))
    assert bench.run(1000)[-1, 0] == ZERO_V + 3 * 3200


def test_a_new_session_does_not_move_a_parked_output(parked_at_1V):
    parked_at_1V.ok(wire.HelloRequest(), session=OTHER)
    assert np.all(parked_at_1V.run(500)[:, 0] == PARKED_AT_1V)


def test_an_armed_device_is_not_taken_from_a_host_that_lives():
    bench = Bench()
    bench.ok(wire.ArmRequest(0))
    bench.run(4000)
    assert bench.status_of(wire.HelloRequest(), session=OTHER) == wire.Status.BUSY
    bench.ok(wire.StatusRequest())
    bench.run(4000)
    assert bench.status_of(wire.HelloRequest(), session=OTHER) == wire.Status.BUSY
    assert bench.state == wire.State.ARMED


def test_one_that_was_left_armed_is_parked_for_the_next_host():
    """Without a timeout a host counts as alive for a second after its last word."""
    bench = Bench()
    bench.set_axis()
    bench.set_path()
    bench.ok(wire.SetTimeoutRequest(0))
    bench.ok(wire.ArmRequest(0))
    bench.run(4900)
    assert bench.status_of(wire.HelloRequest(), session=OTHER) == wire.Status.BUSY
    bench.run(200)
    bench.ok(wire.HelloRequest(), session=OTHER)
    assert bench.status_of(wire.StatusRequest()) == wire.Status.NO_SESSION
    bench.session = OTHER
    bench.run(5)
    status = bench.status()
    assert (status.state, status.fault, status.modes) == (wire.State.PARKED, wire.Fault.NONE, (0, 0, 0))


def test_a_path_that_runs_without_a_timeout_ends_by_stop_alone():
    bench = Bench()
    bench.drive()
    bench.ok(wire.SetTimeoutRequest(0))
    bench.run(20_000)
    assert bench.status_of(wire.HelloRequest(), session=OTHER) == wire.Status.BUSY
    assert bench.state == wire.State.RUNNING


def test_a_session_that_begins_in_a_fault_inherits_nothing():
    """It once could clear the fault, arm, and start the path of the host before it, without a timeout."""
    bench = Bench()
    bench.drive()
    bench.ok(wire.SetTimeoutRequest(0))
    bench.run(300)
    bench.firmware.inject(wire.Fault.INTERLOCK)
    bench.run(2000)
    bench.session = OTHER
    bench.ok(wire.HelloRequest())
    status = bench.status()
    assert (status.state, status.fault) == (wire.State.FAULT, wire.Fault.INTERLOCK)
    assert status.modes == (0, 0, 0)
    bench.ok(wire.ClearFaultRequest())
    bench.ok(wire.ArmRequest(0))
    assert bench.status_of(wire.StartRequest(1)) == wire.Status.BAD_VALUE
    bench.run(5001)
    assert bench.status().fault == wire.Fault.HOST_TIMEOUT


def test_a_session_that_begins_on_the_way_home_inherits_nothing():
    bench = Bench()
    bench.drive(swing=8 * V)
    bench.run(500)
    bench.ok(wire.ParkRequest())
    parked = len(bench.dac)
    bench.session = OTHER
    bench.ok(wire.HelloRequest())
    assert bench.status().modes == (0, 0, 0)
    bench.run(1000)
    codes = bench.dac[parked - 1 :, 0].astype(int)
    assert np.abs(np.diff(codes)).max() <= 33
    assert codes[-1] == ZERO_V
    assert bench.state == wire.State.PARKED


def test_a_new_session_has_no_waveform():
    bench = Bench()
    points = bytes(4096)
    for at in range(0, 4096, 1024):
        bench.ok(wire.WaveChunkRequest(0, at // 4, points[at : at + 1024]))
    bench.ok(wire.WaveCommitRequest(0, crc32(points)))
    bench.set_axis()
    assert bench.set_path(path=wire.PathKind.WAVE) == wire.Status.OK
    bench.session = OTHER
    bench.ok(wire.HelloRequest())
    bench.set_axis()
    assert bench.set_path(path=wire.PathKind.WAVE) == wire.Status.BAD_VALUE


def test_a_stop_that_is_repeated_stops_again():
    bench = Bench()
    stop = bench.frame(wire.StopRequest())
    bench.raw(stop)
    bench.drive(swing=8 * V)
    bench.run(300)
    bench.raw(stop)
    bench.run(2000)
    assert bench.state == wire.State.PARKED


def test_a_retry_shows_that_the_host_lives():
    """A link that loses replies is no dead host."""
    bench = Bench()
    bench.drive()
    frame = bench.frame(wire.StatusRequest())
    for _ in range(8):
        bench.raw(frame)
        bench.run(900)
    assert bench.state == wire.State.RUNNING
    bench.run(5001)
    assert bench.status().fault == wire.Fault.HOST_TIMEOUT


@pytest.mark.parametrize("below", [True, False])
def test_limits_that_leave_out_the_parked_output_are_refused_on_both_sides(below):
    """Taking them would make it jump."""
    bench = Bench()
    at = -V if below else V
    bench.upload(model(u_park_q24=at))
    bench.ok(wire.ArmRequest(0))
    bench.run(300)
    bench.park()
    tight = model(u_min_q24=-V // 2) if below else model(u_max_q24=V // 2)
    assert bench.upload(tight).status == wire.Status.OUTSIDE_LIMITS
    assert bench.session == SESSION
    assert bench.set_axis(0, wire.Mode.PID) == wire.Status.OK
    assert bench.set_path(swing=10 * UM) == wire.Status.OK
