"""Which position follows a path: the stage's, where the model says by how much its sensor is late."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import phaselead as pl
from phaselead.control.tracking import track
from phaselead.control.true_position import followed
from phaselead.device.device import Device
from phaselead.device.quantities import path_request
from phaselead.device.run_file import read_capture
from phaselead.device.wire import PathKind
from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel, Gains, Sensor
from phaselead.model.sensor_lag import sensor_lag_s
from phaselead.model.stage_file import Stage
from phaselead.record.hdf5 import read_hdf5
from phaselead.waveforms.catalogue import parse_wave

LAG_s = 1 / (2 * np.pi * 2000.0)
LOWPASS = AdoptedEffect(name="sensor_lowpass", params={"corner_Hz": 2000.0})
KNOWN = Stage(name="known", axes={"x": AxisModel(sensor=Sensor(bandwidth_Hz=2000.0))})
GAINS = {"x": Gains(kp_V_per_um=0.0, ki_V_per_um_s=20.0, kd_V_s_per_um=2e-5)}


def test_the_lag_is_that_of_the_model_or_the_data_sheet():
    """What acts in the model counts; the data sheet's figure is the same sensor and not a second one."""
    assert sensor_lag_s(AxisModel()) == 0
    assert sensor_lag_s(KNOWN.axes["x"]) == pytest.approx(LAG_s)
    assert sensor_lag_s(AxisModel(effects=(LOWPASS,))) == pytest.approx(LAG_s)
    assert sensor_lag_s(AxisModel(sensor=Sensor(bandwidth_Hz=100.0), effects=(LOWPASS,))) == pytest.approx(LAG_s)


@given(f_Hz=st.floats(1.0, 500.0), offset=st.sampled_from(["", "+20um"]))
def test_the_device_is_asked_for_what_the_sensor_is_to_show(f_Hz, offset):
    """A sine behind a first-order lag."""
    wave = parse_wave(f"sine:60um{offset}@{f_Hz!r}Hz")
    asked = followed({"x": wave}, KNOWN, "true", "pid")["x"]
    t_s, w = np.linspace(0, 3 / f_Hz, 200), 2 * np.pi * f_Hz
    mean = wave.offset + 30
    lagging = mean - 30 * np.real(np.exp(1j * w * t_s) / (1 + 1j * w * LAG_s))
    assert asked.value(t_s) == pytest.approx(lagging, abs=1e-5)
    assert asked.offset + asked.swing * asked.points == pytest.approx(asked.value(np.arange(1024) / 1024 / f_Hz))
    assert asked.as_asked is wave
    assert path_request(0, PathKind.WAVE, asked.swing, asked.offset, f_Hz, 100, volts=False)  # 7 pm were refused


@pytest.mark.parametrize(
    ("wave", "stage", "follows"),
    [
        ("sine:60um@5Hz", KNOWN, "measured"),
        ("sine:60um@5Hz", None, "true"),
        ("sine:60um@5Hz", Stage(name="unknown", axes={"x": AxisModel()}), "true"),
        ("sine:60um@5Hz", Stage(name="other", axes={"y": KNOWN.axes["x"]}), "true"),
        ("goto:60um", KNOWN, "true"),
        ("sine:5V@5Hz", KNOWN, "true"),
    ],
)
def test_other_paths_are_as_they_were_written(wave, stage, follows):
    asked = {"x": parse_wave(wave)}
    assert followed(asked, stage, follows, "pid") == asked


def test_a_path_is_not_made_late_twice():
    once = followed({"x": parse_wave("triangle:60um@5Hz")}, KNOWN, "true", "pid")
    assert followed(once, KNOWN, "true", "pid") == once


def test_figures_are_of_the_path_as_it_was_written():
    wave = parse_wave("sine:60um@20Hz")
    with Device.open("sim://xyz250") as device:
        run = track(device, followed({"x": wave}, KNOWN, "true", "pid"), "pid", gains=GAINS)
    error_um, rows = wave.value(run.t_s) - run.true_um["x"], slice(-1000, None)
    assert run.figures["true"]["max_um"] == np.abs(error_um[rows]).max()
    assert run.figures["true"]["rms_um"] == pytest.approx(np.sqrt(np.mean(error_um[rows] ** 2)))
    assert run.figures["range_um"] == run.figures["true"]["range_um"] == pytest.approx(60.0)
    assert run.figures["sensor_lag_s"] == pytest.approx(LAG_s)
    assert run.figures["max_um"] == np.abs(run.r_um - run.x_um)[rows].max()
    behind = followed({"x": wave}, KNOWN, "true", "pid")["x"].value(run.t_s)
    assert run.r_um == pytest.approx(behind, abs=0.001)


def test_the_true_position_is_kept_beside_the_measured_one(tmp_path):
    with Device.open("sim://xyz250") as device:
        run = track(device, {"x": parse_wave("sine:60um@20Hz")}, "pid", gains=GAINS)
    run.save(tmp_path / "run.h5", overwrite=True)
    kept = read_hdf5(tmp_path / "run.h5").device["true_um"]["x"]
    assert (kept == run.true_um["x"]).all()
    assert 0 < np.abs(kept - run.x_um).max() < 1
    assert read_capture(tmp_path / "run.h5").ticks.shape == run.capture.ticks.shape


def test_what_is_printed_has_the_true_error_beside_the_measured_one():
    """Where one is known: a real stage does not tell."""
    with Device.open("sim://xyz250") as device:
        run = track(device, {"x": parse_wave("sine:60um@5Hz")}, "pid", duration_s=0.4)
    (line,) = [line for line in str(run).splitlines() if "true position" in line]
    assert f"{run.figures['true']['max_um']:.4g}" in line
    figures = {name: value for name, value in run.figures.items() if name != "true"}
    assert "true position" not in str(replace(run, figures=figures))


def test_only_two_positions_can_follow():
    with pl.connect("sim://xyz250") as dev, pytest.raises(BadInput, match="follows 'sensed' is no position"):
        dev.track("sine:10um@20Hz", mode="pid", follows="sensed")
