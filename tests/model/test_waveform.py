"""WAVE arguments: what they mean, and the one line for what they cannot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.errors import BadInput
from phaselead.model.axis import AxisModel
from phaselead.model.table import XU_LI_2010
from phaselead.waveforms.catalogue import parse_wave, parse_waves
from phaselead.waveforms.goto import move_duration_s
from phaselead.waveforms.limits import refuse_out_of_range
from phaselead.waveforms.waveform import POINTS

from stages import assert_one_line  # isort: skip


def parts(text: str) -> tuple[str, float, float, str, float]:
    wave = parse_wave(text)
    return wave.kind, wave.swing, wave.offset, wave.unit, wave.f_Hz


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("sine:60um@5Hz", ("sine", 60, 0, "um", 5)),
        ("sine:60um+20um@5Hz", ("sine", 60, 20, "um", 5)),
        ("sine:60um-5.5um@5Hz", ("sine", 60, -5.5, "um", 5)),
        ("sine:5V@5Hz", ("sine", 5, 0, "V", 5)),
        (" sine: 500 mV + 1 V @ 0.5 kHz ", ("sine", 0.5, 1, "V", 500)),
        ("triangle:1e2µm@20Hz", ("triangle", 100, 0, "um", 20)),
        ("goto:120um", ("goto", 120, 0, "um", 1 / move_duration_s(120, "um"))),
        ("goto:-1V@500ms", ("goto", -1, 0, "V", 2)),
        ("goto:0um@2s", ("goto", 0, 0, "um", 0.5)),
    ],
)
def test_meaning(text: str, meant: tuple[str, float, float, str, float]) -> None:
    assert parts(text) == pytest.approx(meant)


@settings(max_examples=50, deadline=None)
@given(
    kind=st.sampled_from(["sine", "triangle"]),
    swing=st.floats(0.01, 1e3),
    offset=st.floats(-100, 100),
    f=st.floats(0.01, 1e3),
)
def test_periodic_waves_rise_from_the_offset(kind: str, swing: float, offset: float, f: float) -> None:
    wave = parse_wave(f"{kind}:{swing!r}V{offset:+}V@{f!r}Hz")
    assert (wave.swing, wave.offset, wave.f_Hz) == (swing, offset, f)
    period = wave.value(np.arange(2048) / 2048 / f)
    assert period[0] == pytest.approx(offset)
    assert period[512] == pytest.approx(offset + swing / 2)
    assert period[1024] == pytest.approx(offset + swing)
    assert period[1536] == pytest.approx(offset + swing / 2)
    assert period.min() >= offset - 1e-9 * swing
    np.testing.assert_allclose(wave.value(np.arange(2048) / 2048 / f + 3 / f), period, atol=1e-6 * swing)
    assert (wave.lowest, wave.highest) == (offset, offset + swing)


def test_moves_are_smooth_and_hold_their_ends() -> None:
    wave = parse_wave("goto:-5V@2s").from_start(1.0)
    assert wave.duration_s == 2
    t = np.linspace(-1, wave.duration_s + 1, 5001)
    u = wave.value(t)
    assert u[0] == pytest.approx(1)
    assert u[-1] == pytest.approx(-5)
    assert (np.diff(u) <= 0).all()
    speed = np.abs(np.diff(u)).max() / (t[1] - t[0])
    assert speed == pytest.approx(1.875 * 6 / wave.duration_s, rel=1e-3)


def test_a_move_without_a_duration_is_no_faster_than_parking() -> None:
    assert move_duration_s(120, "um") == pytest.approx(1.875 * 120 / 1000)
    assert move_duration_s(-10, "V") == pytest.approx(1.875 * 10 / 50)
    assert move_duration_s(0, "V") > 0


@pytest.mark.parametrize(
    ("content", "unit", "lowest", "highest"),
    [
        ("0\n1\n2\n1\n", "um", 0, 2),
        ("x_um\n-1\n3\n", "um", -1, 3),
        ("u_V\n0\n2.5\n", "V", 0, 2.5),
        ("t_s,r_um\n0,5\n0.03,6\n0.1,5\n", "um", 5, 6),
        ("# one period\n0;5\n1;6\n\n", "um", 5, 6),
        ("0\t5\r\n1\t6\r\n", "um", 5, 6),
        ("x_nm\n-1000\n3000\n", "um", -1, 3),
        ("y_mm\n0\n0.002\n", "um", 0, 2),
        ("t_ms,x_m\n0,0\n30,1e-6\n100,0\n", "um", 0, 1),
        ("t_us,u_mV\n0,0\n30000,2500\n100000,0\n", "V", 0, 2.5),
    ],
)
def test_files_hold_one_period(tmp_path: Path, content: str, unit: str, lowest: float, highest: float) -> None:
    path = tmp_path / "p@1,y.csv"
    path.write_text(content)
    wave = parse_wave(f"file:{path}@10Hz")
    assert (wave.kind, wave.unit, wave.f_Hz) == ("file", unit, 10)
    assert wave.lowest == pytest.approx(lowest)
    assert wave.highest == pytest.approx(highest, abs=0.01)
    assert wave.points is not None
    assert wave.points.shape == (POINTS,)
    assert wave.points.min() == 0
    assert wave.points.max() == pytest.approx(1, abs=0.01)


@settings(max_examples=30, deadline=None)
@given(values=st.lists(st.floats(-100, 100), min_size=4, max_size=32).filter(lambda v: np.ptp(v) > 0.1))
def test_files_are_resampled_periodically(tmp_path_factory: pytest.TempPathFactory, values: list[float]) -> None:
    """Between the points given the wave is a line, the one from the last back to the first included."""
    path = tmp_path_factory.getbasetemp() / "p.csv"
    path.write_text("\n".join(map(repr, values)))
    wave = parse_wave(f"file:{path}@1Hz")
    t = np.arange(POINTS) / POINTS
    for turns in (t, t + 0.5 / POINTS):
        expected = np.interp(turns * len(values), np.arange(len(values) + 1), [*values, values[0]])
        np.testing.assert_allclose(wave.value(turns), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("", "has 0 values"),
        ("1\n", "has 1 values; one period takes at least 2"),
        ("1\n1\n1\n", "all 1; use goto"),
        ("1\nabc\n", "line 2: 'abc' is no number"),
        ("1\nnan\n", "line 2: 'nan' is not finite"),
        ("1,2\n1\n", "line 2: has 1 columns"),
        ("1,2,3\n1,2,3\n", "line 1: has 3 columns"),
        ("t_s,u_V,x_um\n0,1,2\n", "line 2: has 3 columns"),
        ("x_in\n1\n2\n", "column 'x_in' names no axis with a unit; rename it, as in t_s,x_um"),
        ("x_um,t_s\n1,2\n2,3\n", "as in t_s,x_um"),
        ("x_um,y_um\n1,2\n2,3\n", "p.csv drives a column an axis"),
        ("t_ms\n1\n2\n", "its columns are t_ms"),
        ("x_m\n-1e304\n1e304\n", "too large"),
        ("0,1\n0,2\n", "row 2: time does not advance"),
        ("-1e308\n1e308\n", "too large"),
        (b"\xff\xfe\x00", "not text"),
    ],
)
def test_files_that_hold_none(tmp_path: Path, content: str | bytes, told: str) -> None:
    path = tmp_path / "p.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(BadInput) as refusal:
        parse_wave(f"file:{path}@10Hz")
    assert_one_line(refusal.value)
    assert str(path) in str(refusal.value)
    assert told in str(refusal.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "is no kind of waveform; one of sine:60um@5Hz, triangle:100um@20Hz"),
        ("60um@5Hz", "is no kind of waveform"),
        ("sin:60um@5Hz", "'sin' is no kind of waveform"),
        ("sine", "nothing follows the kind; write it as in sine:60um@5Hz"),
        ("sine:60um", "has no frequency"),
        ("sine:60@5Hz", "'60' has no unit: use um or V"),
        ("sine:60mm2@5Hz", "is no swing with a unit"),
        ("sine:60kg@5Hz", "'kg'"),
        ("sine:um@5Hz", "'um' is no swing"),
        ("sine:60um@5", "'5' is no frequency in Hz"),
        ("sine:60um@5s", "'5s' is no frequency"),
        ("sine:60um@0Hz", "frequency '0Hz' must be above 0"),
        ("sine:60um@-5Hz", "frequency '-5Hz' must be above 0"),
        ("sine:60um@1e999Hz", "must be above 0 and finite"),
        ("sine:60um@nanHz", "is no frequency"),
        ("sine:-60um@5Hz", "swing -60 um must be above 0 (peak-to-peak)"),
        ("triangle:0V@5Hz", "swing 0 V must be above 0"),
        ("sine:1e999um@5Hz", "is not finite"),
        ("sine:60um+1V@5Hz", "both in the same unit"),
        ("sine:60um+@5Hz", "is no swing"),
        ("goto:120", "'120' has no unit"),
        ("goto:120um@5Hz", "'5Hz' is no duration; write it as in goto:120um@0.5s"),
        ("goto:120um@0s", "duration '0s' must be above 0"),
        ("file:none.csv@5Hz", "none.csv: cannot be read (No such file or directory)"),
        ("file:p.csv", "has no frequency; write it as in file:path.csv@10Hz"),
    ],
)
def test_refusals_name_the_part_and_show_an_example(text: str, told: str) -> None:
    with pytest.raises(BadInput) as refusal:
        parse_wave(text)
    assert_one_line(refusal.value)
    assert told in str(refusal.value)


def test_several_axes() -> None:
    waves = parse_waves("x=sine:60um@5Hz,z=goto:5um")
    assert {axis: wave.kind for axis, wave in waves.items()} == {"x": "sine", "z": "goto"}
    assert list(parse_waves("sine:60um@5Hz", axis="y")) == ["y"]
    for text, told in [
        ("w=sine:60um@5Hz", "there is no axis w"),
        ("x=sine:60um@5Hz,x=goto:5um", "axis x is given twice"),
        ("x=", "is no kind"),
    ]:
        with pytest.raises(BadInput, match=told):
            parse_waves(text)


@pytest.mark.parametrize(
    ("text", "table", "told"),
    [
        ("sine:5V@5Hz", False, ""),
        ("sine:12V-2V@1Hz", False, ""),
        ("sine:60um@5Hz", True, ""),
        ("sine:5um@5Hz", False, ""),
        ("goto:5um", True, ""),
        ("sine:12V@1Hz", False, r"0\.\.12 V is outside the limits of the output \(-2\.\.10 V\)"),
        ("goto:-3V", False, r"^-3 V is outside"),
        ("sine:5V@100Hz", False, r"needs 1571 V/s, the slew limit is 1000 V/s; stay below 63\.7 Hz"),
        ("triangle:10V@60Hz", False, r"needs 1200 V/s"),
        ("goto:9V@0.01s", False, r"needs 1688 V/s"),
        ("goto:300um", False, r"outside what the sensor sees \(-10\.\.270 um\)"),
        ("sine:255um@1Hz", False, r"outside what the stage reaches \(up to 247\.426 um\)"),
        ("sine:5um@5Hz", True, r"a range of 5 um is outside what was identified"),
        ("sine:60um@30Hz", True, r"frequency 30 Hz lies outside the identified rectangle"),
    ],
)
def test_range_of_the_stage(text: str, table: bool, told: str) -> None:
    axis = AxisModel(table=XU_LI_2010)
    if not told:
        refuse_out_of_range(parse_wave(text), axis, table=table)
        return
    with pytest.raises(BadInput, match=told):
        refuse_out_of_range(parse_wave(text), axis, table=table)


pieces = st.sampled_from(
    [
        "sine",
        "triangle",
        "goto",
        "file",
        ":",
        "60",
        "um",
        "V",
        "@",
        "5",
        "Hz",
        "+",
        "-",
        "1e99",
        "s",
        "x=",
        ",",
        " ",
        ".",
    ]
)


@settings(max_examples=300, deadline=None)
@given(st.text(max_size=20) | st.lists(pieces, max_size=10).map("".join))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        waves = parse_waves(text)
    except BadInput as refusal:
        assert_one_line(refusal)
    else:
        for wave in waves.values():
            assert np.isfinite(wave.value([0.0, 0.3 / wave.f_Hz])).all()


def points_of(text: str) -> np.ndarray:
    (wave,) = parse_waves(text).values()
    return np.asarray(wave.value(np.arange(POINTS) / POINTS * wave.duration_s))


def test_a_square_rests_at_two_levels() -> None:
    values = points_of("square:10um+5um@5Hz")
    assert set(values[60:500]) == {15.0}
    assert set(values[572:]) == {5.0}


@given(steps=st.integers(1, 32), swing=st.floats(0.1, 200), lowest=st.floats(0, 50))
@settings(max_examples=30, deadline=None)
def test_a_staircase_rests_on_every_step(steps: int, swing: float, lowest: float) -> None:
    values = points_of(f"staircase:{swing}um+{lowest}um/{steps}@1Hz")
    assert values[0] == pytest.approx(lowest)
    middles = (np.arange(2 * steps) + 0.5) * POINTS / (2 * steps)
    levels = lowest + swing * np.concatenate([np.arange(1, steps + 1), np.arange(steps)[::-1]]) / steps
    assert values[middles.astype(int)] == pytest.approx(levels, abs=1e-9 * swing + 1e-9)


def test_a_chirp_has_whole_cycles_and_rises_to_its_last_frequency() -> None:
    wave = parse_wave("chirp:5um@1..50Hz")
    values = points_of("chirp:5um@1..50Hz")
    assert values[0] == pytest.approx(0)
    assert abs(wave.value(wave.duration_s * (1 - 1e-9)) - values[0]) < 0.01
    tops = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] > values[2:]))
    rate = np.diff(tops) / POINTS * wave.duration_s
    assert 1 / rate[-1] == pytest.approx(50, rel=0.1)
    assert parse_wave("chirp:5um@500mHz..50Hz").duration_s > wave.duration_s * 0.9


def test_a_raster_steps_where_its_line_turns() -> None:
    waves = parse_waves("raster:60um x 20um+5um/8@10Hz")
    x, y = waves["x"], waves["y"]
    t_s = np.arange(8000) / 5000
    moving = np.abs(np.gradient(y.value(t_s))) > 1e-9
    assert (x.highest, y.lowest, y.highest, y.f_Hz) == (60, 5, 25, 0.625)
    assert x.value(t_s)[moving].max() < 20


def test_a_spiral_goes_round_its_middle() -> None:
    waves = parse_waves("spiral:60um+20um/10@5Hz")
    t_s = np.linspace(0, 4, 40_001)
    x, y = (waves[axis].value(t_s) - 50 for axis in "xy")
    radius = np.hypot(x, y)
    assert radius[0] < 0.2
    assert radius.max() == pytest.approx(30, rel=0.02)
    assert np.count_nonzero(np.diff(np.sign(x[abs(x) > 1e-6])) != 0) == pytest.approx(40, abs=4)


@pytest.mark.parametrize(
    ("text", "ideal"),
    [
        ("spiral:60um/25@2Hz", lambda t: 30 + 15 * (1 - np.cos(2 * np.pi * t / 25)) * np.cos(4 * np.pi * t)),
        ("chirp:5um@1..50Hz", lambda t: 2.5 - 2.5 * np.cos(2 * np.pi * (t + 49 / 2 * t**2 / (26 / 25.5)))),
    ],
)
def test_what_lines_between_the_points_leave_of_a_curve_counts_as_error(
    text: str, ideal: Callable[[np.ndarray], np.ndarray]
) -> None:
    """A run was judged by the lines, as if they had been asked for."""
    wave = parse_waves(text)["x"]
    t_s = np.linspace(0, wave.duration_s, 100_001)
    assert wave.value(t_s) == pytest.approx(ideal(t_s), abs=1e-9)
    between = np.abs(wave.playable(t_s) - ideal(t_s)).max()
    assert wave.unplayed == pytest.approx(between, rel=0.01)
    assert between > 0.02
    assert wave.judged_apart
    assert wave.points is not None
    assert wave.offset + wave.swing * wave.points == pytest.approx(ideal(np.arange(POINTS) / POINTS * wave.duration_s))


def test_a_step_goes_from_where_the_axis_is() -> None:
    step = parse_wave("step:5um").from_start(40.0)
    assert (step.offset, step.swing, step.duration_s) == (40, 5, pytest.approx(0.0006))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("staircase:60um@1Hz", "a number of steps from 1 to 32"),
        ("staircase:60um/99@1Hz", "a number of steps from 1 to 32"),
        ("chirp:5um@50..1Hz", "must rise"),
        ("chirp:5um@1Hz", "no range of frequencies"),
        ("step:5V", "use goto:5V"),
        ("raster:6um/5@5Hz", "the length of a line"),
        ("raster:6um x 5V/5@5Hz", "in the same unit"),
        ("spiral:6um/100@5Hz", "a number of turns from 1 to 25"),
        ("x=spiral:6um/10@5Hz", "give it alone"),
    ],
)
def test_levels_sweeps_and_scans_that_cannot_be(text: str, said: str) -> None:
    with pytest.raises(BadInput, match=said) as caught:
        parse_waves(text)
    assert_one_line(caught.value)
