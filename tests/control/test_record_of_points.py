"""A recording of a path whose points are sent while it is played: the whole path, as `track` plays it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import phaselead as pl
from phaselead.cli import main
from phaselead.control import record_to_file, track_to_file
from phaselead.device import Device
from phaselead.record import read_recording
from phaselead.waveforms import parse_waves

CORNERS = "t_s,u_V\n0,5\n0.5,7\n1,3\n1.5,5\n"


@pytest.fixture
def waves(tmp_path: Path):
    (tmp_path / "corners.csv").write_text(CORNERS)
    return parse_waves(f"path:{tmp_path / 'corners.csv'}", "x")


def test_a_path_is_recorded_to_its_end(tmp_path: Path, waves):
    for name, play in (("record", record_to_file), ("track", track_to_file)):
        with Device.open("sim://xyz250") as device:
            mode = () if name == "record" else ("open",)
            play(device, waves, *mode, output=str(tmp_path / f"{name}.h5"), duration_s=2.5)
    recorded, tracked = (read_recording(str(tmp_path / f"{name}.h5")).axes["x"].u_V for name in ("record", "track"))
    np.testing.assert_array_equal(recorded, tracked)
    assert recorded.max() == pytest.approx(7.0, abs=0.01)
    assert recorded[np.argmax(recorded) :].min() == pytest.approx(3.0, abs=0.01)


def test_what_a_table_of_points_cannot_follow_is_said_before_it_is_recorded(tmp_path: Path):
    t_s = np.arange(0, 3, 4e-4)
    fast = np.c_[t_s, 5 + 0.4 * np.sin(2 * np.pi * 400 * t_s)]
    np.savetxt(tmp_path / "fast.csv", fast, delimiter=",", header="t_s,u_V", comments="")
    drive, output = f"file:{tmp_path / 'fast.csv'}@0.3333Hz", str(tmp_path / "a.h5")
    ran = CliRunner().invoke(main, ["log", "record", "--drive", drive, "--duration", "0.2", "-o", output])
    assert ran.exit_code == 0, ran.output
    assert "warning: x: the device plays 1024 points a period" in ran.output
    with pl.connect() as dev, pytest.warns(UserWarning, match="1024 points a period"):
        dev.record(drive, duration=0.2)
