"""An axis whose output stands still is passed over in a tick; what goes on meanwhile must not be."""

import numpy as np
import pytest
from device_bench import UM, Bench, V

from phaselead.device import wire
from phaselead.device.encode_model import device_model
from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.model.stage_file import Stage


def crept(rest_ticks, volts):
    """DAC codes of an inverse move after a second at so many volts and a rest; the model has a creep of 0.1 s."""
    time = TimeView(gain_um_per_V=15.0, u_range_V=(-2.0, 10.0), rate_Hz=5000.0)
    creep = AdoptedEffect(name="creep", params={"k": [0.1], "tau_s": [0.1]})
    bench = Bench()
    bench.ok(wire.SetTimeoutRequest(0))
    bench.upload(device_model(Stage(name="s", axes={"x": AxisModel(time=time, effects=(creep,))})))
    bench.drive(path=wire.PathKind.MOVE, swing=volts * V, step=2**64 // 100)
    bench.run(5000)
    bench.park()
    bench.run(rest_ticks)
    bench.drive(mode=wire.Mode.INVERSE, path=wire.PathKind.MOVE, swing=40 * UM, step=2**64 // 100)
    return bench.run(200)[:, 0].astype(int)


def test_creep_goes_on_while_the_output_rests():
    """It once stood still with the output, and the next run began with the creep of long ago."""
    fresh = crept(0, volts=0)
    assert np.max(np.abs(crept(0, volts=8) - fresh)) > 10
    assert np.max(np.abs(crept(7500, volts=8) - fresh)) <= 1


@pytest.mark.parametrize("axis", range(3))
def test_an_axis_moves_while_the_others_rest(axis):
    bench = Bench()
    bench.run(50)
    bench.drive(axis=axis, swing=8 * V)
    codes = bench.run(500).astype(int)
    assert [bool(np.ptp(codes[:, i]) > 20_000) for i in range(3)] == [i == axis for i in range(3)]
    assert not np.ptp(np.delete(codes, axis, axis=1))
