"""Files as paths: judged as they are, whatever the device can play of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.control.tracking import path_warnings, track
from phaselead.control.true_position import followed
from phaselead.device.device import Device
from phaselead.model.axis import AxisModel, Gains, Sensor
from phaselead.model.sensor_lag import sensor_lag_s
from phaselead.model.stage_file import Stage
from phaselead.waveforms.catalogue import parse_wave
from phaselead.waveforms.waveform import POINTS

SENSED = Stage(name="sensed", axes={"x": AxisModel(sensor=Sensor(bandwidth_Hz=500.0))})
GAINS = {"x": Gains(kp_V_per_um=0.0, ki_V_per_um_s=1.0, kd_V_s_per_um=0.0)}


def written(folder, values, f_Hz):
    path = folder / "path.csv"
    np.savetxt(path, values, header="x_um", comments="")
    return parse_wave(f"file:{path}@{f_Hz}Hz")


def ripple(rows, waves):
    """40 um, and 1 um ``waves`` times a period on it."""
    turns = np.arange(rows) / rows
    return 20 * (1 - np.cos(2 * np.pi * turns)) + 0.5 * (1 - np.cos(2 * np.pi * waves * turns))


@given(values=st.lists(st.floats(0.0, 100.0), min_size=2, max_size=60).filter(lambda v: np.ptp(v) > 0.01))
def test_the_path_is_that_of_the_file_at_every_row(tmp_path_factory, values):
    wave = written(tmp_path_factory.mktemp("any"), values, 2.0)
    at_rows = wave.value(np.arange(len(values)) / len(values) / 2.0)
    assert at_rows == pytest.approx(np.array(values), abs=1e-6)
    assert wave.points.shape == (POINTS,)
    assert 0 <= wave.points.min() <= wave.points.max() <= 1


@given(rows=st.sampled_from([2, 16, 512, 1024]), seed=st.integers(0, 99))
def test_what_fits_into_the_table_is_played_exactly(tmp_path_factory, rows, seed):
    values = np.random.default_rng(seed).uniform(0, 50, rows)
    wave = written(tmp_path_factory.mktemp("fits"), values, 2.0)
    assert wave.unplayed < 1e-6
    assert path_warnings({"x": wave}) == []


def test_what_is_between_the_points_is_not_turned_into_something_else(tmp_path):
    """A ripple of 800 waves a period came out as one of 224, up to 1.77 um off; averaged, it is left out."""
    wave = written(tmp_path, ripple(50_000, 800), 0.1)
    assert wave.unplayed < 0.75
    (line,) = path_warnings({"x": wave})
    assert f"left by up to {wave.unplayed:.3g} um" in line


def test_a_smooth_file_of_many_rows_needs_no_warning(tmp_path):
    wave = written(tmp_path, ripple(50_000, 0), 5.0)
    assert wave.unplayed < 0.001
    assert path_warnings({"x": wave}) == []


def test_a_run_is_judged_by_the_file(tmp_path):
    """The error against the altered path was 0.18 %, whatever the file said."""
    wave = written(tmp_path, ripple(50_000, 800), 1.0)
    with Device.open("sim://xyz250") as device:
        run = track(device, {"x": wave}, "pid", gains=GAINS, duration_s=1.0)
    error_um = wave.value(run.t_s) - run.recording.axes["x"].x_um
    assert run.figures["max_um"] == pytest.approx(np.abs(error_um).max())
    assert run.figures["unplayed_um"] == wave.unplayed
    assert np.abs(run.r_um - wave.value(run.t_s)).max() > 0.4
    assert run.error_um["x"] == pytest.approx(error_um)


def test_what_is_too_fast_to_be_played_counts_whole_though_the_sensor_is_late(tmp_path):
    """The sensor's lag took it out of the path that was judged: a fifth of the error was left."""
    wave = written(tmp_path, np.random.default_rng(3).normal(20, 3, 50_000), 1.0)
    asked = followed({"x": wave}, SENSED, "true", "pid")
    with Device.open("sim://xyz250") as device:
        run = track(device, asked, "pid", gains=GAINS, duration_s=1.0)
    assert run.figures["rms_um"] == pytest.approx(run.figures["true"]["rms_um"], rel=0.02)
    assert run.figures["rms_um"] == pytest.approx(np.sqrt(np.mean(run.error_um["x"] ** 2)))


def test_a_path_that_can_be_played_is_judged_as_the_sensor_shows_it(tmp_path):
    wave = written(tmp_path, ripple(512, 3), 1.0)
    late = followed({"x": wave}, SENSED, "true", "pid")["x"]
    t_s = np.linspace(0, 1, 999)
    lag_s = sensor_lag_s(SENSED.axes["x"])
    lagging = 20 * (1 - lagged(1.0, t_s, lag_s)) + 0.5 * (1 - lagged(3.0, t_s, lag_s))
    assert late.value(t_s) == pytest.approx(lagging, abs=1e-3)


def lagged(f_Hz, t_s, lag_s):
    """A cosine behind a first-order lag."""
    return np.real(np.exp(2j * np.pi * f_Hz * t_s) / (1 + 2j * np.pi * f_Hz * lag_s))
