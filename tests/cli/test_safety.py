"""What the command line refuses to do to a stage: steps, levels beyond its limits, and contradicting calibrations."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import h5py
import numpy as np
import pytest

from phaselead.control.tracking import assumed_limits, from_standing
from phaselead.device.device import Device
from phaselead.device.encode_model import device_model
from phaselead.device.standing import Standing
from phaselead.identify.experiment import identify_device
from phaselead.identify.plan import Experiment
from phaselead.model.axis import AxisModel, Gains, Limits, Sensor
from phaselead.model.stage_file import Stage, save_stage
from phaselead.waveforms.catalogue import parse_wave


@pytest.mark.parametrize(("wave", "mode"), [("sine:1V+6V@5Hz", "open"), ("sine:60um+20um@5Hz", "pid")])
def test_an_offset_that_is_asked_for_is_reached_no_faster_than_the_slew_limit(run, tmp_path, wave, mode):
    path = tmp_path / "run.h5"
    assert run("track", wave, "--mode", mode, "-o", path).status == 0
    with h5py.File(path) as kept:
        steps = np.abs(np.diff(kept["device/x/dac"][:].astype(int)))
    assert steps.max() <= 0.2 * 3200 + 1


def test_the_way_to_an_offset_is_no_part_of_the_path(run):
    """It was counted, and 100 um of a path of 10 um printed as 999.91 %."""
    outcome = run("track", "sine:10um+100um@5Hz", "--mode", "pid", "--json", "-")
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.json["from_rest"]["max_pct"] < 40


def test_a_file_that_begins_off_zero_is_entered_there(run, tmp_path):
    path = tmp_path / "wave.csv"
    path.write_text("x_um\n100\n110\n120\n110\n")
    outcome = run("track", f"file:{path}@5Hz", "--mode", "pid", "--json", "-")
    assert outcome.status == 0
    assert outcome.json["from_rest"]["max_um"] < 10


def test_a_path_from_rest_begins_without_a_step(run, tmp_path):
    path = tmp_path / "run.h5"
    assert run("track", "sine:5V+0.05V@5Hz", "--mode", "open", "-o", path).status == 0
    with h5py.File(path) as kept:
        assert np.abs(np.diff(kept["device/x/dac"][:].astype(int))).max() <= 0.06 * 3200


def test_a_move_begins_where_the_axis_stands():
    standing = Standing(u_V=5.0, x_um=100.0)
    assert from_standing("x", parse_wave("sine:60um+99um@5Hz"), standing, None).offset == 99
    assert from_standing("x", parse_wave("goto:3V"), standing, None).offset == 5
    assert from_standing("x", parse_wave("goto:120um"), standing, None).offset == 100


def contradicting(folder: Path) -> Path:
    """A stage file whose converter is not the one that the device powered on with."""
    path = folder / "stage.toml"
    path.write_text(
        'format = "phaselead-stage"\nversion = 1\nname = "wrong"\n'
        "[axes.x.limits]\nu_min_V = -1.0\nu_max_V = 11.0\n"
        "[axes.x.actuator]\nu_min_V = -2.048\nu_max_V = 12.0\n"
    )
    return path


def test_a_calibration_that_contradicts_the_dac_is_refused_with_what_to_correct(run, tmp_path):
    outcome = run("track", "sine:5V@5Hz", "--mode", "open", "--model", contradicting(tmp_path))
    assert outcome.status != 0
    assert outcome.error is None
    assert "dac_zero_code contradicts the DAC" in outcome.err
    assert "[actuator]" in outcome.err


SHORT = [
    Experiment("x", swing, f, 1, 2, held_out=(swing, f) == (2.0, 12.0), rest_s=0.0)
    for swing in (1.0, 2.0, 3.0, 4.0)
    for f in (8.0, 12.0, 20.0)
]
NARROW = Stage(
    name="narrow",
    axes={
        "x": AxisModel(
            limits=Limits(u_max_V=6.0, slew_V_per_s=500.0),
            sensor=Sensor(x_min_um=-10.0, x_max_um=270.5),
            gains=Gains(kp_V_per_um=0.01, ki_V_per_um_s=1.0, kd_V_s_per_um=0.0),
        )
    },
)


def test_identify_refuses_levels_beyond_the_limits_before_anything_moves(run, tmp_path):
    model = tmp_path / "narrow.toml"
    save_stage(model, NARROW)
    outcome = run("identify", "--model", model, "-o", tmp_path / "out.toml")
    assert outcome.status == 2
    assert "the level of 10 V at 20 Hz does not fit the limits (-2..6 V" in outcome.err
    assert not (tmp_path / "out.toml").exists()


@pytest.mark.parametrize("given", [True, False])
def test_identify_keeps_limits_and_calibration(given):
    """Of the model it is given, or of the one the device holds."""
    with Device.open("sim://xyz250") as device:
        if not given:
            device.upload(device_model(NARROW))
        found = identify_device(device, plan=SHORT, stage=NARROW if given else None, creep=False).stage
    axis, wanted = found.axis("x"), NARROW.axis("x")
    assert found.provenance.parent_sha256 == NARROW.sha256
    assert axis.limits.u_max_V == 6
    assert axis.limits.slew_V_per_s == pytest.approx(500)
    assert axis.sensor.x_max_um == pytest.approx(270.5, abs=0.01)
    assert axis.gains == (wanted.gains if given else None)


def test_assumed_figures_are_said_but_not_for_the_built_in_stage(tmp_path):
    stage = tmp_path / "mine.toml"
    stage.write_text(files("phaselead.sim").joinpath("xyz250.toml").read_text())
    with Device.open(f"sim://{stage}") as device:
        line = assumed_limits(device)
        assert line is not None
        assert "-10..270 um" in line
        assert "-2..10 V" in line
        device.upload(device_model(NARROW))
        assert assumed_limits(device) is None
    with Device.open("sim://xyz250") as device:
        assert assumed_limits(device) is None


def test_a_place_for_the_records_is_sought_before_anything_moves(run, tmp_path):
    (tmp_path / "file").write_text("no folder")
    outcome = run("identify", "--save", tmp_path / "file", "-o", tmp_path / "out.toml")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "give another with --save" in outcome.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_an_upload_says_what_the_hard_limits_hold_back(run, stage_file, tmp_path):
    port = ("--port", f"sim://xyz250?state={tmp_path / 'flash.bin'}")
    assert run("limits", "--axis", "x", "--u-max", "8V", *port).status == 0
    outcome = run("upload", stage_file, *port)
    assert outcome.status == 0, outcome.err
    assert outcome.err.count("warning: axis x: u_max_V 10 is held to 8 V") == 1
