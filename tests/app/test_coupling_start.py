"""Axes that are coupled begin without a step, wherever they stand.

They once stepped by up to 0.33 V: what the others cause was taken off from the first tick on, and nobody had put it in.
"""

from dataclasses import replace

import numpy as np
import pytest
from device_bench import MID_CODE, Bench, V, model

from phaselead.device import wire

HERE = wire.PathFlag.FROM_HERE
CODES_PER_V = 3200
JOIN_TICKS = 500
STILL = 100
"""DAC codes: a join of 500 ticks has not gone further in its first 20 ticks; the step was of 1000."""
GAINS = {"kp": V // 1000, "ki": 1 << 14}


def standing_at(*volts):
    """A device whose three coupled axes rest at these voltages and are armed."""
    bench = Bench()
    blob = model()
    axes = tuple(replace(axis, u_park_q24=round(u * V)) for axis, u in zip(blob.axes, volts, strict=True))
    assert bench.upload(replace(blob, axes=axes)).status == wire.Status.OK
    bench.ok(wire.SetTimeoutRequest(0))
    bench.ok(wire.ArmRequest(0))
    bench.run(1200)
    assert np.array_equal(bench.dac[-1], [32768 + round(u * CODES_PER_V) for u in volts])
    return bench


def set_hold(bench, axis, mode):
    """It is to hold where it stands, which it enters by a join."""
    assert bench.set_axis(axis, mode, **(GAINS if "PID" in mode.name else {})) == wire.Status.OK
    assert bench.set_path(axis, path=wire.PathKind.HOLD, swing=0, offset=0) == wire.Status.OK
    bench.ok(wire.SetJoinsRequest(axis, HERE, JOIN_TICKS, 0))


def run(bench, ticks):
    """Sensors that are noisy, as live ones are."""
    return bench.run(ticks, adc=MID_CODE + np.arange(ticks)[:, None] % 2)


def way_from(bench, mask):
    """How far each output goes from before a start to 20 ticks after, DAC codes."""
    before = bench.dac[-1].astype(int)
    bench.ok(wire.StartRequest(mask))
    return np.abs(run(bench, 20).astype(int) - before).max(axis=0)


@pytest.mark.parametrize("mode", [wire.Mode.INVERSE, wire.Mode.INVERSE_PID])
@pytest.mark.parametrize("volts", [(5, 5, 5), (8, -1, 3), (0, 7, 0)])
@pytest.mark.parametrize("axes", [(0, 1, 2), (0, 2), (1,)])
def test_axes_with_inverses(mode, volts, axes):
    bench = standing_at(*volts)
    for axis in axes:
        set_hold(bench, axis, mode)
    assert way_from(bench, sum(1 << axis for axis in axes)).max() < STILL
    run(bench, 2 * JOIN_TICKS)
    assert bench.state == wire.State.RUNNING


@pytest.mark.parametrize("modes", [("INVERSE", "PID", "INVERSE"), ("FF_PID", "INVERSE", "PID")])
def test_axes_with_and_without_inverses(modes):
    bench = standing_at(5, 6, 4)
    for axis, mode in enumerate(modes):
        set_hold(bench, axis, wire.Mode[mode])
    assert way_from(bench, 7).max() < STILL


def test_axes_that_begin_while_they_ramp_home():
    bench = standing_at(5, 6, 4)
    for again in range(2):
        for axis in range(3):
            set_hold(bench, axis, wire.Mode.INVERSE)
        assert way_from(bench, 7).max() < STILL, again
        run(bench, JOIN_TICKS // 2)  # the sensor says that they stand elsewhere: there they go
        bench.park()
        bench.ok(wire.ArmRequest(0))


def test_a_hold_that_is_queued():
    bench = standing_at(5, 6, 4)
    for axis in range(3):
        set_hold(bench, axis, wire.Mode.INVERSE)
    bench.ok(wire.StartRequest(7))
    run(bench, 2 * JOIN_TICKS)
    hold = wire.Segment(wire.PathKind.HOLD, HERE, 0, 0, 0, 0, JOIN_TICKS, 0)
    for _ in range(2):
        before = bench.dac[-1].astype(int)
        assert bench.status_of(wire.QueueRequest(7, 1, 0, (hold,) * 3)) == wire.Status.OK
        assert np.abs(run(bench, 2 * JOIN_TICKS).astype(int) - before).max() < STILL
