"""``path:``: files of any length, sent to the device while it plays them, and judged as they are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.control import PAPER_GAINS
from phaselead.control.tracking import track
from phaselead.device import TICK_HZ, Device, DeviceFault, PointFeeder, RanDry
from phaselead.errors import BadInput, DeviceRefused
from phaselead.sim.replaying import replay
from phaselead.waveforms import parse_wave, parse_waves


def write(folder, header, *columns, name="path.csv"):
    path = folder / name
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def wander(t_s, seed=0):
    """Between some micrometres, slow enough for any mode, at rest at both ends."""
    rng = np.random.default_rng(seed)
    ends = np.sin(np.pi * t_s / t_s[-1]) ** 2
    return 20 + ends * sum(4 * rng.normal() / n * np.sin(2 * np.pi * (n * t_s + rng.uniform())) for n in range(1, 4))


@pytest.fixture
def device():
    with Device.open("sim://xyz250") as opened:
        yield opened


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), row_s=st.sampled_from([0.0002, 0.0007, 0.003, 0.02]), log2=st.integers(0, 3))
def test_points_lie_on_a_path_that_has_fewer_rows_than_points(seed, row_s, log2, tmp_path_factory):
    t_s = np.arange(0, 1.5, row_s)
    wave = parse_wave(f"path:{write(tmp_path_factory.mktemp('p'), 't_s,x_um', t_s, wander(t_s, seed))}")
    at_s = np.arange(1000) * 2**log2 / TICK_HZ
    inside = at_s < wave.duration_s
    played = wave.offset + wave.swing * wave.points_of(0, 1000, log2)
    if row_s >= 2 * 2**log2 / TICK_HZ:
        np.testing.assert_allclose(played[inside], wave.value(at_s)[inside], atol=1e-9)
    assert wave.unplayed <= max(0.002, wave._left_by(0))


def test_a_file_of_more_rows_than_ticks_is_averaged_and_the_difference_is_said(tmp_path):
    """A tone of 20 kHz would be heard as one of 0 Hz where points were taken as they come."""
    t_s = np.arange(0, 0.5, 1 / 100_000)
    slow = 20 + 5 * np.sin(2 * np.pi * t_s) ** 2
    wave = parse_wave(f"path:{write(tmp_path, 't_s,x_um', t_s, slow + 0.5 * np.cos(2 * np.pi * 20_000 * t_s))}")
    played = wave.offset + wave.swing * wave.points_of(5, 2000, 0)
    assert np.abs(played - np.interp(np.arange(5, 2005) / TICK_HZ, t_s, slow)).max() < 0.05
    assert 0.4 < wave.unplayed < 1


def test_before_its_begin_and_after_its_end_a_path_keeps_its_speed(tmp_path):
    t_s = np.arange(0, 1, 0.01)
    wave = parse_wave(f"path:{write(tmp_path, 't_s,x_um', t_s, 20 + 10 * np.sin(5 * t_s))}")
    points = wave.points_of(-100, 5000 + 200, 0)
    assert np.abs(np.diff(points, 2)).max() < 1.2 * np.abs(np.diff(wave.points_of(0, 4900, 0), 2)).max()


def test_a_long_path_is_followed_replayed_and_judged_by_the_file(tmp_path, device):
    t_s = np.arange(0, 2, 0.004)
    x_um, y_nm = wander(t_s), 1e3 * wander(t_s, 1)
    waves = parse_waves(f"path:{write(tmp_path, 't_s,x_um,y_nm', t_s, x_um, y_nm)}")
    assert sorted(waves) == ["x", "y"]
    run = track(device, waves, "pid", gains=dict.fromkeys("xy", PAPER_GAINS))
    np.testing.assert_allclose(run.recording.axes["x"].r_um, np.interp(run.t_s, t_s, x_um), atol=0.003)
    np.testing.assert_allclose(run.recording.axes["y"].r_um, np.interp(run.t_s, t_s, y_nm / 1e3), atol=0.003)
    assert len(run.t_s) == round(t_s[-1] * TICK_HZ)
    assert run.figures["axes"]["x"]["judged"] == "whole record"
    assert replay(run.capture) is None


def test_one_that_repeats_goes_round(tmp_path, device):
    turns = np.arange(3000) / 3000
    wave = parse_wave(f"path:{write(tmp_path, 'x_um', 20 - 5 * np.cos(2 * np.pi * turns))}@3Hz")
    run = track(device, {"x": wave}, "pid", gains={"x": PAPER_GAINS}, duration_s=1)
    np.testing.assert_allclose(run.recording.axes["x"].r_um, 20 - 5 * np.cos(2 * np.pi * 3 * run.t_s), atol=0.003)


def test_a_host_that_is_late_is_told_where_the_axes_stopped(tmp_path, device, monkeypatch):
    """Without a kick, without a fault, and kept in what was recorded."""
    t_s = np.arange(0, 3, 0.004)
    wave = parse_wave(f"path:{write(tmp_path, 't_s,x_um', t_s, wander(t_s))}")
    feed, calls = PointFeeder.feed, []

    def late(self):
        calls.append(1)
        if not 10 < len(calls) < 150:
            feed(self)

    monkeypatch.setattr(PointFeeder, "feed", late)
    with pytest.raises(RanDry, match=r"ran dry [0-2]\.\d+ s after its begin: its points came too late") as caught:
        track(device, {"x": wave}, "pid", gains={"x": PAPER_GAINS})
    capture = caught.value.capture
    reference = capture.axes["x"].reference[(capture.ticks > capture.start_tick)] / 2**16
    driven = reference[: np.argmax(capture.ticks >= capture.end_tick) + 400]
    assert np.abs(np.diff(driven)).max() < 0.05
    assert np.ptp(driven[-20:]) == 0
    assert device.status().state == "parked"


def test_a_fault_on_the_way_is_named(tmp_path):
    """Points that came after it were refused, and that was said instead."""
    t_s = np.arange(0, 3, 0.001)
    wave = parse_wave(f"path:{write(tmp_path, 't_s,x_um', t_s, wander(t_s))}")
    with (
        Device.open("sim://xyz250?force=x:400um@1s") as device,
        pytest.raises(DeviceFault, match="fault adc_rail on axis x"),
    ):
        track(device, {"x": wave}, "pid", gains={"x": PAPER_GAINS})


@pytest.mark.parametrize(
    ("header", "columns", "said"),
    [
        ("t_s,x_um,x_nm", 3, "two columns of axis x"),
        ("t_s,r_um,x_um", 3, "each names its axis"),
        ("t_s,x_inch", 2, "names no axis with a unit"),
        ("t_s", 1, "a column x_um is what is played"),
        ("x_um,y_um", 2, "no column t_s; give a rate"),
    ],
)
def test_files_that_are_refused(tmp_path, header, columns, said):
    rows = np.arange(5.0)
    with pytest.raises(BadInput, match=said):
        parse_waves(f"path:{write(tmp_path, header, *[rows + n for n in range(columns)])}")


def test_decimal_commas_and_a_column_that_is_not_there_are_named(tmp_path):
    (tmp_path / "comma.csv").write_text("t_s;x_um\n0;1,5\n0,2;2,5\n")
    with pytest.raises(BadInput, match="decimal commas; write points"):
        parse_waves(f"path:{tmp_path / 'comma.csv'}")
    rows = np.arange(5.0)
    path = write(tmp_path, "t_s,x_um,y_um", rows, rows, rows)
    with pytest.raises(BadInput, match=r"no column of axis z, only of x, y$"):
        parse_waves(f"z=path:{path}")


def test_what_cannot_be_played_is_refused_before_anything_moves(tmp_path, device):
    t_s = np.arange(0, 1, 0.01)
    path = write(tmp_path, "t_s,x_um", t_s, wander(t_s))
    high = write(tmp_path, "t_s,x_um", t_s, 300 * t_s, name="high.csv")
    other = write(tmp_path, "t_s,x_um", t_s / 2, wander(t_s), name="other.csv")
    gains = dict.fromkeys("xy", PAPER_GAINS)
    for text, mode, said in (
        (f"path:{high}", "pid", "outside what the sensor sees"),
        (f"path:{path}", "open", "takes volts"),
        (f"x=path:{path},y=path:{other}", "pid", "must end together"),
    ):
        with pytest.raises(BadInput, match=said):
            track(device, parse_waves(text), mode, gains=gains)
    with pytest.raises((BadInput, DeviceRefused)):
        track(device, parse_waves(f"path:{path}"), "ff", gains=gains)
    status = device.status()
    assert status.state == "parked"
    assert (status.at_rest, np.ptp(status.dac_codes)) == ("xyz", 0)
