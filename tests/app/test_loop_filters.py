"""Filters of the loop on the device: with the gains they came with, without a bump, or refused."""

from dataclasses import replace

import numpy as np
import pytest
from device_bench import UM, Bench, V, model

from phaselead.device import wire

ONE = 1 << 26
NONE = wire.Biquad(0, 0, 0, 0, 0)
LOW_PASS = wire.Biquad(ONE // 4, 0, 0, -(ONE // 2 + ONE // 4), 0)
UNSTABLE = wire.Biquad(ONE, 0, 0, -ONE, ONE)
OTHER_GAIN = replace(LOW_PASS, b1_q26=1)
TOO_LARGE = wire.Biquad(16 * ONE, -15 * ONE, 0, 0, 0)
GAINS = (V // 50, 1 << 20, 0, 0x7FFFFFFF)
NEAR, FAR = 16_391, 16_800
"""Codes of 60 um, all but, and of nearly 2 um more."""


def holding(filters=(NONE, NONE)):
    """Axis x holds 60 um under feedback."""
    bench = Bench()
    assert bench.upload(model()).status == wire.Status.OK
    bench.ok(wire.SetTimeoutRequest(0))
    bench.ok(wire.SetAxisRequest(0, wire.Mode.PID, *GAINS, filters))
    bench.ok(wire.SetPathRequest(0, wire.PathKind.HOLD, 0, 60 * UM, 0, 0))
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StartRequest(1))
    bench.run(20, adc=NEAR)
    return bench


def test_a_command_that_is_shorter_has_none():
    """As hosts of before send it: the same output as with none, in place of those that were set."""
    older = holding((LOW_PASS, LOW_PASS))
    older.ok(wire.ParkRequest())
    older.run(2500, adc=NEAR)
    body = wire.SetAxisRequest(0, wire.Mode.PID, *GAINS).pack()[:18]

    class Older(wire.SetAxisRequest):
        def pack(self):
            return body

    older.ok(Older(0, wire.Mode.PID, *GAINS))
    older.ok(wire.SetPathRequest(0, wire.PathKind.HOLD, 0, 60 * UM, 0, 0))
    older.ok(wire.ArmRequest(0))
    older.ok(wire.StartRequest(1))
    older.run(20, adc=NEAR)
    assert np.array_equal(older.run(50, adc=FAR)[:, 0], holding().run(50, adc=FAR)[:, 0])


def test_they_are_at_work():
    """A low-pass lets the step of P through bit by bit."""
    pairs = ((LOW_PASS, NONE), (NONE, NONE))
    filtered, plain = (holding(filters).run(20, adc=FAR)[:, 0].astype(int) for filters in pairs)
    assert np.all(filtered[:10] > plain[:10])
    assert filtered[0] - plain[0] > 10 * abs(filtered[-1] - plain[-1])


@pytest.mark.parametrize("before", [(NONE, NONE), (LOW_PASS, NONE), (LOW_PASS, LOW_PASS)])
@pytest.mark.parametrize("after", [(NONE, NONE), (NONE, LOW_PASS), (LOW_PASS, LOW_PASS)])
def test_they_change_on_the_way_without_a_bump(before, after):
    bench = holding(before)
    last = bench.run(60, adc=NEAR)[-1, 0]
    bench.firmware.write(bench.frame(wire.SetGainsRequest(0, *GAINS, after)))
    assert np.abs(bench.run(5, adc=NEAR)[:, 0].astype(int) - int(last)).max() <= 2


@pytest.mark.parametrize("filters", [(UNSTABLE, NONE), (NONE, OTHER_GAIN), (LOW_PASS, TOO_LARGE)])
def test_those_that_cannot_be_used_are_refused_and_nothing_changes(filters):
    bench, twin = holding((LOW_PASS, LOW_PASS)), holding((LOW_PASS, LOW_PASS))
    assert bench.status_of(wire.SetGainsRequest(0, *GAINS, filters)) == wire.Status.BAD_VALUE
    assert twin.status_of(wire.SetGainsRequest(0, -1, 0, 0, 1)) == wire.Status.BAD_VALUE
    assert np.array_equal(bench.run(100, adc=FAR), twin.run(100, adc=FAR))
    bench.ok(wire.ParkRequest())
    bench.run(2500, adc=NEAR)
    assert bench.status_of(wire.SetAxisRequest(0, wire.Mode.PID, *GAINS, filters)) == wire.Status.BAD_VALUE
