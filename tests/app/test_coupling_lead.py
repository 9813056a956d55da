"""What the other axes cause is led in modes without an inverse too, by where they are measured to be."""

import numpy as np
import pytest
from device_bench import COUPLING, KNOTS, MID_CODE, PLAYS, UM, Bench, V, model

from phaselead.device import wire
from phaselead.device.stream import decode_samples

UM_PER_CODE = 280 / 65536
LOW_V, HIGH_V, GAIN = -2.0, 10.0, 14.0
MEAN = GAIN + sum(s * (HIGH_V - d) for d, s in KNOTS) / (HIGH_V - LOW_V)
LARGEST = [max(abs(share) for j, share in enumerate(row) if j != i) for i, row in enumerate(COUPLING)]
SWINGS_V = [share * (HIGH_V - LOW_V) for share in LARGEST]
SLOPES = np.array([MEAN + sum(w * max(1 - 2 * r / swing_V, 0) for r, w in PLAYS) for swing_V in SWINGS_V])
"""Of loops of each axis as large as what the whole way of another causes there, um/V."""


def feedforwards(modes, steps):
    """Feed-forward in V of every axis before and after the ADC codes have jumped by ``steps``, shape (2, 3)."""
    bench = Bench()
    assert bench.upload(model()).status == wire.Status.OK
    mask = sum(1 << axis for axis, mode in enumerate(modes) if mode != wire.Mode.IDLE)
    for axis, mode in enumerate(modes):
        if mode == wire.Mode.IDLE:
            continue
        assert bench.set_axis(axis, mode, kp=V // 1000) == wire.Status.OK
        swing = 0 if mode == wire.Mode.OPEN else 66 * UM
        assert bench.set_path(axis, path=wire.PathKind.HOLD, swing=0, offset=swing) == wire.Status.OK
    bench.ok(wire.SetTimeoutRequest(0))
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StreamStartRequest(wire.Channel.FEEDFORWARD, 7, 1))
    bench.ok(wire.StartRequest(mask))
    bench.run(30)
    bench.run(10, adc=[MID_CODE + step for step in steps])
    assert bench.state == wire.State.RUNNING
    stopped = bench.ok(wire.StreamStopRequest())
    bench.run(10)
    stream = decode_samples([bytes(wire.HEADER.size) + b.pack() for b in bench.samples], None, stopped.sent_ticks)
    volts = np.array([axis.feedforward for axis in stream.axes.values()]) / 2**11
    jumped = np.flatnonzero(np.any(np.diff(volts), axis=0))
    return volts[:, [20, -3]].T, jumped


@pytest.mark.parametrize("mode", [wire.Mode.PID, wire.Mode.FF_PID])
@pytest.mark.parametrize("steps", [(900, 0, 0), (0, -700, 0), (500, 800, -600)])
def test_a_jump_of_the_others_is_led_by_the_inverse_of_the_coupling(mode, steps):
    volts, _ = feedforwards((mode,) * 3, steps)
    way_um = np.array(steps) * UM_PER_CODE
    caused_um = way_um - np.linalg.solve(np.array(COUPLING), way_um)
    assert (np.abs(caused_um) / SLOPES).max() > 0.005
    assert volts[1] - volts[0] == pytest.approx(-caused_um / SLOPES, abs=1.1 / 2**11)


def test_an_axis_that_follows_no_path_counts_for_nothing():
    """Its sensor may not be there."""
    volts, jumped = feedforwards((wire.Mode.IDLE, wire.Mode.PID, wire.Mode.PID), (900, 0, 0))
    assert np.array_equal(volts[0], volts[1])
    assert not any(at > 25 for at in jumped)


def test_an_axis_with_an_inverse_is_led_by_where_the_others_are_measured():
    volts, _ = feedforwards((wire.Mode.PID, wire.Mode.INVERSE_PID, wire.Mode.IDLE), (900, 0, 0))
    way_um = 900 * UM_PER_CODE
    (xx, xy), (yx, yy) = np.array(COUPLING)[:2, :2]
    moved_um = -yx / (xx * yy - xy * yx) * way_um
    assert moved_um < -0.1
    assert np.sign(volts[1, 1] - volts[0, 1]) == np.sign(moved_um)
    assert abs(volts[1, 0] - volts[0, 0]) < 0.001
