"""Paths that begin at an offset: the way there is gentle where the model says how gentle, and said where not."""

import numpy as np
import pytest

from phaselead.control.approach import approach_slew_V_per_s
from phaselead.control.gains import design_gains
from phaselead.control.tracking import path_warnings, track
from phaselead.device.device import Device
from phaselead.device.encode_model import device_model
from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.model.stage_file import Stage
from phaselead.waveforms.catalogue import parse_wave

AXIS = AxisModel(
    time=TimeView(gain_um_per_V=15.0, delay_s=0.0003, u_range_V=(-2.0, 10.0), rate_Hz=5000.0),
    effects=(AdoptedEffect(name="resonance", params={"f_Hz": 200.0, "zeta": 0.02}),),
)
STAGE = Stage(name="model", axes={"x": AXIS})
GAINS = {"x": design_gains("x", AXIS)}


@pytest.mark.parametrize("mode", ["pid", "inverse", "inverse+pid"])
def test_a_sine_at_an_offset_is_approached_gently_and_the_model_is_put_back(mode):
    """It jumped by 100 um at 1000 V/s."""
    path = {"x": parse_wave("sine:10um+100um@5Hz")}
    assert path_warnings(path, STAGE) == []
    with Device.open("sim://xyz250") as device:
        run = track(device, path, mode, stage=STAGE, gains=GAINS, duration_s=1.0)
        assert device.read_model() == device_model(STAGE)
    rate_V_per_s = np.abs(np.diff(run.u_V)).max() * 5000
    assert rate_V_per_s <= approach_slew_V_per_s(STAGE, "x", path["x"]) + 2
    assert rate_V_per_s < 100
    assert run.figures["approach_s"] < 0.5


@pytest.mark.parametrize("wave", ["sine:60um@5Hz", "triangle:10um+100um@5Hz", "sine:60um+40um@150Hz"])
def test_paths_that_need_the_slew_limit_keep_it(wave):
    assert approach_slew_V_per_s(STAGE, "x", parse_wave(wave)) is None


def test_a_jump_is_said():
    (line,) = path_warnings({"x": parse_wave("triangle:10um+100um@5Hz")}, STAGE)
    assert "at the slew limit" in line
    assert len(path_warnings({"x": parse_wave("sine:10um+100um@5Hz")}, None)) == 1
