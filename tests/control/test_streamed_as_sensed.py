"""A path that repeats and is streamed, where the sensor is late or corners are rounded, stays as fine as its file."""

import numpy as np
import pytest
from one_mode_model import STAGE

from phaselead.control import PAPER_GAINS
from phaselead.control.rounding import rounding_s
from phaselead.control.running import of_table
from phaselead.control.tracking import path_warnings, track
from phaselead.control.true_position import followed
from phaselead.device import TICK_HZ, Device
from phaselead.model.axis import AxisModel, Sensor
from phaselead.model.stage_file import Stage
from phaselead.waveforms import RepeatedAsSensed, parse_wave

LAG_s = 1 / (2 * np.pi * 2000.0)
KNOWN = Stage(name="known", axes={"x": AxisModel(sensor=Sensor(bandwidth_Hz=2000.0))})
PERIOD_s = 2.0


def fast_and_slow(t_s, lag_s=0.0):
    """A slow tone and one of 400 periods, behind a first-order lag: 1024 points a period turned that into another."""
    slow, fast = (np.exp(2j * np.pi * f_Hz * t_s) / (1 + 2j * np.pi * f_Hz * lag_s) for f_Hz in (0.5, 200.0))
    return 20 - 20 * np.real(slow) + 0.5 * np.imag(fast)


def written(folder, values, *, at="@0.5Hz"):
    path = folder / "path.csv"
    np.savetxt(path, values, header="x_um", comments="", fmt="%.9g")
    return parse_wave(f"path:{path}{at}")


def wave_of(folder, rows):
    return written(folder, fast_and_slow(np.arange(rows) / rows * PERIOD_s))


@pytest.mark.parametrize("rows", [20_000, 40_000, 133_337])
def test_points_are_what_a_late_sensor_shows_of_the_file(tmp_path, rows):
    wave = wave_of(tmp_path, rows)
    asked = followed({"x": wave}, KNOWN, "true", "pid")["x"]
    t_s = np.arange(10_000) / TICK_HZ
    played = asked.offset + asked.swing * asked.points_of(0, len(t_s), 0)
    assert np.abs(played - fast_and_slow(t_s, LAG_s)).max() < (0.004 if rows <= 20_000 else 0.01)  # means over a tick
    assert np.abs(asked.value(t_s) - fast_and_slow(t_s, LAG_s)).max() < 0.004
    assert asked.as_asked is wave
    assert asked.unplayed == wave.unplayed < 0.02


@pytest.mark.parametrize("rounding_s", [0.0, 0.0011])
def test_points_are_the_same_wherever_they_are_asked_for(tmp_path, rounding_s):
    """A period may take hours: it is worked out part by part."""
    wave = RepeatedAsSensed.of(wave_of(tmp_path, 30_000), LAG_s, rounding_s)
    whole = wave.points_of(0, 12_000, 0)
    for first, count in ((0, 3), (4_997, 9), (9_990, 100)):
        np.testing.assert_allclose(wave.points_of(first, count, 0), whole[first : first + count], atol=1e-12)
    np.testing.assert_allclose(wave.points_of(500, 50, 2), whole[2000:2200:4], atol=1e-12)
    t_s = np.linspace(0.0, 1.9, 50)
    assert wave.value(t_s + 20 * PERIOD_s) == pytest.approx(wave.value(t_s), abs=1e-6)
    assert [float(wave.value(t)) for t in t_s[:3]] == pytest.approx(wave.value(t_s)[:3])


def test_the_device_plays_that_and_the_true_position_is_judged_by_the_file(tmp_path):
    wave = wave_of(tmp_path, 20_000)
    with Device.open("sim://xyz250") as device:
        asked = followed({"x": wave}, KNOWN, "true", "pid")
        run = track(device, asked, "pid", gains={"x": PAPER_GAINS}, duration_s=1)
    assert np.abs(run.recording.axes["x"].r_um - fast_and_slow(run.t_s, LAG_s)).max() < 0.005
    assert run.figures["sensor_lag_s"] == pytest.approx(LAG_s)
    error_um = fast_and_slow(run.t_s) - run.true_um["x"]
    assert run.figures["true"]["max_um"] == pytest.approx(np.abs(error_um).max(), abs=0.004)


def test_corners_are_rounded_and_that_is_said(tmp_path):
    turns = np.arange(4000) / 4000
    wave = written(tmp_path, 30 * np.abs(2 * (turns * 50 % 1) - 1), at="@1Hz")  # 50 Hz of 30 um
    over_s = rounding_s(STAGE.axes["x"], wave, "inverse")
    asked = followed({"x": wave}, STAGE, "measured", "inverse")["x"]
    assert asked.rounding_s == over_s > 0
    points = asked.swing * asked.points_of(0, 5000, 0)
    assert np.abs(np.diff(points, 2)).max() < 0.6 * np.abs(np.diff(30 * wave.points_of(0, 5000, 0), 2)).max()
    (said,) = path_warnings({"x": asked})
    assert "corners" in said
    assert 0.1 < asked.unplayed < 1


def test_what_is_learned_is_a_table_that_says_what_it_leaves_out(tmp_path):
    wave = wave_of(tmp_path, 20_000)
    table = of_table(wave)
    t_s = np.linspace(0, 3, 5000)
    assert np.allclose(table.value(t_s), wave.value(t_s))
    assert 0.2 < table.unplayed < 0.6
    assert "`track` stream it" in path_warnings({"x": table})[0]
