"""Corners that the output is too slow for are rounded, by no more than that takes, and the path that was asked for is
what counts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_mode_model import AXIS, STAGE

from phaselead.control.motion_limits import PATH_ROOM
from phaselead.control.tracking import path_warnings, track
from phaselead.control.true_position import followed
from phaselead.device.device import Device
from phaselead.model.axis import Limits
from phaselead.model.stage_file import Stage
from phaselead.sim import virtual_stage
from phaselead.waveforms.catalogue import parse_wave


def slower(slew_V_per_s):
    limits = AXIS.limits.model_copy(update={"slew_V_per_s": slew_V_per_s})
    return Stage(name="model", axes={"x": AXIS.model_copy(update={"limits": limits})})


SLOW = slower(780.0)
TRIANGLE = "triangle:30um@50Hz"


def rounded_of(wave, stage=STAGE, mode="inverse"):
    played = followed({"x": parse_wave(wave)}, stage, "measured", mode)["x"]
    return getattr(played, "rounding_s", 0.0)


@pytest.mark.parametrize(
    ("wave", "stage", "mode"),
    [
        ("triangle:30um@5Hz", STAGE, "inverse"),
        ("sine:60um@50Hz", STAGE, "inverse"),
        ("sine:60um@180Hz", STAGE, "inverse"),
        ("sine:60um@300Hz", STAGE, "inverse"),
        ("sine:60um@100Hz", SLOW, "inverse"),
        ("triangle:200um@100Hz", STAGE, "inverse"),
        (TRIANGLE, STAGE, "pid"),
        (TRIANGLE, None, "inverse"),
        (TRIANGLE, Stage(name="other", axes={"y": AXIS}), "inverse"),
        (TRIANGLE, Stage(name="stiff", axes={"x": AXIS.model_copy(update={"effects": ()})}), "inverse"),
        ("triangle:2V@50Hz", STAGE, "inverse"),
        ("goto:60um", STAGE, "inverse"),
        ("chirp:60um@1..400Hz", STAGE, "inverse"),
    ],
)
def test_only_corners_are_rounded(wave, stage, mode):
    """A path that is too fast at its mode and below stays what it is, for a rehearsal to refuse."""
    assert rounded_of(wave, stage, mode) == 0


@given(swing_um=st.floats(20.0, 60.0), slew_V_per_s=st.floats(500.0, 1500.0))
def test_larger_paths_and_slower_outputs_are_rounded_more(swing_um, slew_V_per_s):
    """The two go together: the inverse of these sections is linear."""
    wave, stage = f"triangle:{swing_um!r}um@40Hz", slower(slew_V_per_s)
    found = rounded_of(wave, stage)
    assert found <= rounded_of(f"triangle:{1.1 * swing_um!r}um@40Hz", stage) or found == 0
    assert found >= rounded_of(wave, slower(1.1 * slew_V_per_s))
    assert found == pytest.approx(rounded_of(f"triangle:{2 * swing_um!r}um@40Hz", slower(2 * slew_V_per_s)), abs=1e-7)


def driven(asked, folder):
    path = folder / "stage.toml"
    virtual_stage(STAGE).save(path, overwrite=True)
    with Device.open(f"sim://{path}") as device:
        return track(device, {"x": asked}, "inverse", stage=STAGE, duration_s=0.4, force=True)


def test_the_output_stays_below_its_limit_and_the_error_is_against_the_corner(tmp_path):
    wave = parse_wave(TRIANGLE)
    asked = followed({"x": wave}, STAGE, "true", "inverse")["x"]
    run = driven(asked, tmp_path)
    sharp = driven(wave, tmp_path)
    fastest, limited = (float(np.abs(np.diff(one.recording.axes["x"].u_V[1000:])).max()) * 5000 for one in (run, sharp))
    assert limited > 0.99 * Limits().slew_V_per_s
    assert fastest < limited
    assert fastest > 0.5 * PATH_ROOM * Limits().slew_V_per_s  # no more than it takes
    error_um = wave.value(run.t_s) - run.true_um["x"]
    assert run.figures["true"]["max_um"] == np.abs(error_um[-400:]).max()
    assert run.figures["unplayed_um"] == pytest.approx(asked.unplayed)
    measured_um = asked.value(run.t_s) - run.x_um  # late as the sensor is, and sharp
    assert run.figures["max_um"] == pytest.approx(np.abs(measured_um[-400:]).max(), abs=1e-3)
    assert run.figures["max_um"] > np.abs(run.r_um - run.x_um)[-400:].max() + 0.1
    assert sharp.figures["true"]["rms_um"] > run.figures["true"]["rms_um"]


def test_what_is_rounded_is_said():
    asked = followed({"x": parse_wave(TRIANGLE)}, STAGE, "measured", "inverse")
    (said,) = path_warnings(asked)
    assert "corners" in said
    assert f"left by up to {asked['x'].unplayed:.3g} um" in said
    assert 0.1 < asked["x"].unplayed < 1
    assert not path_warnings(followed({"x": parse_wave("sine:30um@50Hz")}, STAGE, "measured", "inverse"))
