"""Paths on the model before they are driven: what would end in a fault is refused while nothing has moved."""

import re
from contextlib import suppress

import pytest

from phaselead.control.gains import design_gains
from phaselead.control.journal import track_to_file
from phaselead.control.rehearsal import rehearse
from phaselead.device.capture import DeviceFault
from phaselead.device.device import Device
from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.model.stage_file import Stage
from phaselead.waveforms.catalogue import parse_wave

AXIS = AxisModel(
    time=TimeView(
        gain_um_per_V=15.0, play_r_V=(0.2, 1.0), play_w_um_per_V=(3.0, 3.0), delay_s=0.0003, u_range_V=(-2.0, 10.0),
        rate_Hz=5000.0,
    ),
    effects=(AdoptedEffect(name="resonance", params={"f_Hz": 200.0, "zeta": 0.02}),),
)  # fmt: skip
STAGE = Stage(name="model", axes={"x": AXIS})
GAINS = {"x": design_gains("x", AXIS)}


def refusal(text, mode="inverse+pid"):
    with pytest.raises(BadInput) as caught:
        rehearse({"x": parse_wave(text)}, mode, STAGE, GAINS)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("wave", ["sine:60um@300Hz", "triangle:200um@100Hz"])
def test_a_path_that_is_far_too_fast_is_refused_with_what_works(wave):
    """These moved, then faulted."""
    line = refusal(wave)
    assert "on the model this " in line
    assert re.search("ends in fault|cut by the output's limits", line)
    kind, _, rate = re.split("[:@]", wave)
    swing_um = float(re.search(r"a swing of up to ([\d.]+) um", line)[1])
    rehearse({"x": parse_wave(f"{kind}:{0.99 * swing_um}um@{rate}")}, "inverse+pid", STAGE, GAINS)


@pytest.mark.parametrize("mode", ["pid", "inverse", "inverse+pid"])
@pytest.mark.parametrize("wave", ["sine:60um@5Hz", "sine:30um@100Hz", "triangle:60um@20Hz", "goto:120um"])
def test_what_the_stage_can_do_is_let_through(wave, mode):
    rehearse({"x": parse_wave(wave)}, mode, STAGE, GAINS)


def test_nothing_is_said_where_nothing_is_known():
    fast = {"x": parse_wave("sine:60um@300Hz")}
    rehearse(fast, "pid", None, {})
    rehearse(fast, "pid", Stage(name="bare", axes={"x": AxisModel()}), GAINS)
    rehearse({"y": fast["x"]}, "pid", STAGE, {"y": GAINS["x"]})


def test_refused_means_not_moved_and_force_goes_on():
    path = {"x": parse_wave("triangle:200um@100Hz")}
    with Device.open("sim://xyz250") as device:
        with pytest.raises(BadInput):
            track_to_file(device, path, "inverse+pid", output=None, stage=STAGE, gains=GAINS)
        status = device.status()
        assert (status.state, status.model_crc) == ("parked", "00000000")
        with suppress(DeviceFault):
            track_to_file(device, path, "inverse+pid", output=None, stage=STAGE, gains=GAINS, force=True)
        assert device.status().model_crc != status.model_crc
