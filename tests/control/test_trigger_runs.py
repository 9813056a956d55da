"""Triggers from Python and the command line: what they are called, what is recorded of them, what makes no sense."""

from __future__ import annotations

import numpy as np
import pytest

import phaselead as pl
from phaselead.control import parse_outputs
from phaselead.device import Session, read_capture
from phaselead.errors import BadInput
from phaselead.record import export
from phaselead.sim.replaying import replay
from phaselead.waveforms import parse_waves

RASTER = "raster:20um x 8um/4@10Hz"


def outputs(text, wave=RASTER):
    return parse_outputs(text, parse_waves(wave, None))


def test_lines_are_of_the_fast_axis_and_frames_of_the_slow_one():
    frame, line, pixel = outputs("frame,line,pixel=256")
    assert [(one.axis, one.turns) for one in (frame, line, pixel)] == [("y", 1), ("x", 1), ("x", 256)]
    assert [one.axis for one in outputs("y:line,target,y:target")] == ["y", "x", "y"]
    assert outputs(None) is None
    assert outputs("none") == []


def test_pixels_of_a_distance_are_in_the_middle_of_each():
    both, up = outputs("pixel=500nm,pixel=+0.5um", "sine:20um+10um@5Hz")
    assert (both.every_um, both.from_um, both.rising) == (0.5, 10.25, False)
    assert up.rising


@pytest.mark.parametrize(
    ("text", "wave", "said"),
    [
        ("frame,line,pixel=2ms,start", RASTER, "the device has 3"),
        ("pixle=3", RASTER, "makes no sense; there are start, frame"),
        ("pixel", RASTER, "makes no sense"),
        ("line=3", RASTER, "makes no sense"),
        ("", RASTER, "makes no sense"),
        ("z:line", RASTER, "axis z follows no path"),
        ("pixel=0", RASTER, "above 0"),
        ("pixel=1.5", RASTER, "write pixel=256"),
        ("pixel=3V", RASTER, "write pixel=256"),
        ("pixel=600", RASTER, "at most 500"),
        ("pixel=0.3ms", RASTER, "a multiple of a tick, 0.2 ms; the nearest is 0.2 ms"),
        ("pixel=41um", RASTER, "spans 20 um and never comes to the first pixel, 20.5 um above"),
        ("pixel=10nm", RASTER, "further apart, or go slower"),
        ("pixel=0.5nm", "goto:0.001um@1s", "at least 0.002 um"),
        ("line", "goto:5um", "goto has no period"),
        ("target", "sine:5V@5Hz", "in volts there are start, frame, line"),
        ("pixel=1um", "sine:5V@5Hz", "in volts there are start, frame, line"),
    ],
)
def test_what_makes_no_sense_is_one_line(text, wave, said):
    with pytest.raises(BadInput, match=said) as refusal:
        [one.request(0) for one in outputs(text, wave)]
    assert "\n" not in str(refusal.value)


def test_a_raster_gives_frames_lines_and_pixels_and_records_them(tmp_path):
    with pl.connect() as dev:
        run = dev.track(RASTER, mode="pid", duration=1.6, trigger_out="frame,line,pixel=64", output=tmp_path / "run.h5")
        again = dev.track("sine:5um@5Hz", mode="pid", duration=0.2)
    assert run.figures["triggers"] == {"frame": 2, "line": 16, "pixel=64": 1024}
    assert np.allclose(run.triggers["line"], np.arange(16) / 10, atol=1e-9)
    assert "pulses: frame 2, line 16, pixel=64 1024" in str(run)
    assert run.recording.meta["trigger_out"] == ["frame", "line", "pixel=64"]
    stream = read_capture(tmp_path / "run.h5").axes["x"]
    assert stream.trigger is not None
    assert replay(read_capture(tmp_path / "run.h5")) is None
    assert again.triggers == {}
    assert "triggers" not in again.figures


def test_an_output_that_waits_for_a_rest_that_never_comes_says_so():
    with pl.connect() as dev:
        run = dev.track("sine:20um@50Hz", mode="pid", trigger_out="target,start", duration=0.1)
    assert "target never pulsed: the path never rested" in str(run)
    assert "start never pulsed" not in str(run)


@pytest.mark.parametrize("suffix", ["csv", "h5", "mat", "parquet"])
def test_pulses_are_exported_row_by_row(tmp_path, suffix):
    """A table without them was of no use beside the frames of a camera."""
    with pl.connect() as dev:
        run = dev.track(RASTER, mode="pid", duration=0.8, trigger_out="frame,line,pixel=64")
    run.save(tmp_path / "raster.h5", overwrite=True)
    export(pl.read(tmp_path / "raster.h5@0:0.4")[0], tmp_path / f"out.{suffix}")
    trigger = column_of(tmp_path / f"out.{suffix}")
    assert trigger.shape == (2000,)
    for output, times_s in enumerate(run.triggers.values()):
        pulsed = np.flatnonzero(trigger >> output & 1) / 5000
        assert pulsed == pytest.approx(times_s[times_s < 0.4])


def column_of(path):
    if path.suffix == ".csv":
        return np.genfromtxt(path, delimiter=",", names=True)["trigger"].astype(int)
    if path.suffix == ".h5":
        import h5py

        with h5py.File(path) as file:
            return file["trigger"][:]
    if path.suffix == ".mat":
        import scipy.io

        return scipy.io.loadmat(path)["trigger"][:, 0]
    from pyarrow import parquet

    return parquet.read_table(path)["trigger"].to_numpy()


def test_without_outputs_there_is_no_such_column(tmp_path):
    with pl.connect() as dev:
        dev.track("sine:20um@5Hz", mode="pid", duration=0.2).save(tmp_path / "plain.csv", overwrite=True)
    assert (tmp_path / "plain.csv").read_text().splitlines()[0] == "t_s,u_V,x_um,r_um"


def test_outputs_of_a_run_end_with_it():
    with pl.connect() as dev:
        dev.track("sine:5um@5Hz", mode="pid", duration=0.2, trigger_out="line")
        run = dev.track("sine:5um@5Hz", mode="pid", duration=0.2, trigger_out="start")
    assert list(run.triggers) == ["start"]


def test_pixels_of_a_distance_are_where_the_reference_is():
    with pl.connect() as dev:
        run = dev.track("triangle:20um@4Hz", mode="pid", duration=1, trigger_out="pixel=1um,pixel=+1um")
    assert run.figures["triggers"] == {"pixel=1um": 160, "pixel=+1um": 80}
    rows = np.searchsorted(run.t_s, run.triggers["pixel=+1um"] - 1e-9)
    a_tick_um = 20 * 2 * 4 / 5000
    assert np.abs(run.r_um[rows] - (np.round(run.r_um[rows] - 0.5) + 0.5)).max() <= a_tick_um + 0.01


def test_three_axes_and_their_triggers_fit_the_line():
    with pl.connect() as dev:
        run = dev.track(
            x="sine:5um@5Hz", y="sine:5um@5Hz", z="sine:5um@2Hz", mode="pid", duration=0.5, trigger_out="frame"
        )
    assert run.figures["triggers"] == {"frame": 1}
    assert run.figures["dropped"] == 0


def test_a_window_for_pulses_limits_no_path_that_waits_for_an_edge():
    """Without a model moves keep to 1000 um/s, and the path was refused as if it were one."""
    with pl.connect("sim://xyz250?trigger=0.3s") as dev:
        run = dev.track("sine:40um@10Hz", mode="pid", duration=0.3, trigger_out="target,start", trigger_in=3)
    assert run.triggers["start"].tolist() == [0.0]


@pytest.mark.parametrize(
    ("wave", "mode"),
    [("sine:10um@5Hz", "pid"), ("goto:20um", "pid"), ("sine:2V@5Hz", "open"), ("triangle:10um@5Hz", "pid")],
)
def test_a_run_begins_at_the_edge_and_can_be_replayed(tmp_path, wave, mode):
    with pl.connect("sim://xyz250?trigger=1s") as dev:
        run = dev.track(
            wave,
            mode=mode,
            duration=0.4,
            trigger_out="start",
            trigger_in=3,
            output=tmp_path / "run.h5",
        )
    capture = read_capture(tmp_path / "run.h5")
    edge = 5000
    joins = 0 if wave.startswith("goto") else 250
    assert capture.status.first_tick == edge + 1 + joins
    assert len(run.t_s) == 2000
    if mode != "open":
        assert run.triggers["start"].tolist() == [0.0]
        assert abs(run.r_um[0] - run.r_um[1]) < 0.03  # it begins at rest, or as slowly as a triangle
    assert replay(capture) is None


def test_a_path_of_points_begins_at_the_edge(tmp_path):
    t_s = np.arange(2000) / 1000
    rows = np.column_stack([t_s, 10 - 10 * np.cos(2 * np.pi * t_s)])
    np.savetxt(tmp_path / "scan.csv", rows, delimiter=",", header="t_s,x_um", comments="")
    with pl.connect("sim://xyz250?trigger=1s") as dev:
        run = dev.track(f"path:{tmp_path / 'scan.csv'}", mode="pid", trigger_in=3, output=tmp_path / "run.h5")
    assert abs(run.r_um - np.interp(run.t_s, t_s, rows[:, 1])).max() < 0.01
    assert replay(read_capture(tmp_path / "run.h5")) is None


def test_without_an_edge_it_parks_says_so_and_leaves_nothing(tmp_path):
    with pl.connect() as dev:
        with pytest.raises(pl.DeviceRefused, match=r"no edge came at the trigger input within 0\.5 s"):
            dev.track("sine:10um@5Hz", mode="pid", trigger_in=0.5, output=tmp_path / "run.h5")
        assert dev.status().state == "parked"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("edge", "is_kept"), [("4s", False), ("1s", True)])
@pytest.mark.parametrize("held", [False, True])
def test_who_interrupts_a_run_keeps_what_came_since_the_edge(tmp_path, monkeypatch, edge, is_kept, held):
    """What waited was kept as a run that has begun."""
    pump = Session.pump
    with pl.connect(f"sim://xyz250?trigger={edge}") as dev:
        if held:
            dev.move(x=20, mode="pid")

        def interrupted(self, size):
            pump(self, size)
            if self._tick > 2 * 5000:
                monkeypatch.setattr(Session, "pump", pump)
                raise KeyboardInterrupt

        monkeypatch.setattr(Session, "pump", interrupted)
        with pytest.raises(KeyboardInterrupt):
            dev.track(
                "sine:10um+20um@5Hz", mode="pid", duration=5, trigger_in=5, output=tmp_path / "run.h5", force=True
            )
    assert [one.name for one in tmp_path.iterdir()] == (["run.h5.journal"] if is_kept else [])


def test_a_move_and_a_sine_cannot_begin_at_one_edge():
    with pl.connect() as dev, pytest.raises(BadInput, match="cannot begin in the same tick"):
        dev.track(x="goto:5um", y="sine:5um@5Hz", mode="pid", trigger_in=1)


def test_a_move_waits_for_the_edge_and_pulses_when_it_has_settled():
    with pl.connect("sim://xyz250?trigger=2s") as dev:
        dev.move(x=20)
        moved = dev.move(x=30, trigger_in=5, trigger_out="target").axes["x"]
        assert dev.device.session.request(pl.device.wire.StatusRequest()).first_tick == 10_001
        assert moved.settled_s is not None
        assert abs(moved.x_um - 30) < 0.2
        with pytest.raises(pl.DeviceRefused, match="no edge came"):
            dev.move(x=40, trigger_in=0.3)
        held = dev.where().x
        assert held.held
        assert not held.moving
        assert abs(held.x_um - 30) < 0.2


def test_a_pulse_comes_once_each_step_has_settled():
    with pl.connect() as dev:
        run = dev.track("staircase:12um/3@0.5Hz", mode="pid", duration=2, trigger_out="target")
    at = run.triggers["target"]
    assert len(at) == 6
    for second in at:
        row = round(second * 5000)
        window = slice(row - 50, row)
        assert np.ptp(run.r_um[window]) == 0
        assert np.abs(run.r_um[window] - run.x_um[window]).max() < 0.06
