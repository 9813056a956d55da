"""Corners of any path: followed, rounded by what the output can do, or refused with how much slower it is accepted."""

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from one_mode_model import AXIS, STAGE

import phaselead as pl
from phaselead.control.motion_limits import PATH_ROOM, motion_limits
from phaselead.control.path_speed import (
    beyond_slew,
    beyond_speed,
    hardest,
    refuse_path_too_fast,
    refuse_voltage_too_fast,
    times_slower,
)
from phaselead.control.rehearsal import rehearse
from phaselead.control.rounding import rounding_s
from phaselead.control.true_position import followed
from phaselead.control.voltage_rate import voltage_rate
from phaselead.errors import BadInput
from phaselead.model import TICK_S, Gains
from phaselead.sim import built_in, virtual_stage
from phaselead.waveforms import Rounded, Streamed, parse_wave

SLEW_V_per_s = AXIS.limits.slew_V_per_s
FASTEST_um_per_s = motion_limits(AXIS).velocity_um_per_s
GAINS = {"x": Gains(kp_V_per_um=0.0, ki_V_per_um_s=15.0, kd_V_s_per_um=1e-5)}


def streamed(folder, t_s, x_um, name="path.csv", at=""):
    path = folder / name
    np.savetxt(path, np.column_stack([t_s, x_um]), delimiter=",", header="t_s,x_um", comments="", fmt="%.9g")
    return parse_wave(f"path:{path}{at}")


def corner(folder, ramp_s, um=20.0, begin_s=0.5, end_s=1.0):
    return streamed(folder, [0, begin_s, begin_s + ramp_s, end_s], [50, 50, 50 + um, 50 + um])


def accepted(wave, mode="inverse"):
    return beyond_speed(wave, AXIS, mode) is None and beyond_slew(wave, AXIS, mode) is None


@st.composite
def any_path(draw):
    """Rows of any kind: from jumps within a tick to what any stage follows."""
    values = draw(st.lists(st.floats(0, 100), min_size=3, max_size=8).filter(lambda v: np.ptp(v) > 0.1))
    gaps_ms = draw(st.lists(st.sampled_from([0.1, 0.3, 1, 3, 10, 50]), min_size=len(values), max_size=len(values)))
    return np.concatenate([[0.0], np.cumsum(gaps_ms[1:])]) / 1e3, np.array(values)


def as_fast_as_is_accepted(wave, mode):
    times = times_slower(wave, lambda tried, _spans_s: None if accepted(tried, mode) else 0.0)
    return wave.scaled(time=times)


@settings(max_examples=40)
@given(rows=any_path(), slower=st.floats(1.0, 20.0), mode=st.sampled_from(["pid", "inverse"]))
def test_what_is_accepted_stays_so_when_it_is_slower(rows, slower, mode, tmp_path_factory):
    """Of a path with rows between two ticks that is not so: what these hold is hardly played, and is once they are a
    tick apart."""
    wave = as_fast_as_is_accepted(streamed(tmp_path_factory.mktemp("slower"), *rows), mode)
    assume(np.diff(wave.times_s).min() >= TICK_S)
    assert accepted(wave.scaled(time=slower), mode)


@settings(max_examples=40)
@given(rows=any_path(), mode=st.sampled_from(["pid", "inverse"]))
def test_what_is_refused_names_how_much_slower_it_is_accepted(rows, mode, tmp_path_factory):
    wave = streamed(tmp_path_factory.mktemp("refused"), *rows)
    try:
        refuse_path_too_fast("x", wave, AXIS, mode)
        refuse_voltage_too_fast("x", wave, AXIS, mode)
    except BadInput as error:
        line = str(error)
    else:
        return
    assert "\n" not in line
    assert re.search(r" at [\d.e-]+ s", line)
    times = float(re.search(r"or ([\d.]+) times as long as a whole", line)[1])
    assert times > 1
    assert accepted(wave.scaled(time=times), mode)


@settings(max_examples=20)
@given(rows=any_path())
def test_the_voltage_of_what_is_accepted_stays_within_the_slew_limit(rows, tmp_path_factory):
    """By the sections of the inverse, tick by tick, of the points that are sent."""
    wave = as_fast_as_is_accepted(streamed(tmp_path_factory.mktemp("voltage"), *rows), "inverse")
    played = followed({"x": wave}, STAGE, "true", "inverse")["x"]
    rate = voltage_rate(AXIS, played)
    assert max(rate.within(block, 0.0)[0] for block in rate.blocks) <= SLEW_V_per_s * (1 + 1e-9)


@pytest.mark.parametrize(("ramp_s", "is_rounded"), [(0.1, False), (0.02, False), (0.002, True), (0.001, True)])
def test_a_corner_is_rounded_where_the_output_is_too_slow_for_it(tmp_path, ramp_s, is_rounded):
    """No corner of a path: was, and what the slew limit cut off rang the stage."""
    wave = corner(tmp_path, ramp_s)
    played = followed({"x": wave}, STAGE, "true", "inverse")["x"]
    assert isinstance(played, Rounded) is is_rounded
    assert played.as_asked is wave
    assert (played.unplayed > 0.1) is is_rounded
    assert followed({"x": wave}, STAGE, "true", "pid")["x"] is wave
    assert beyond_slew(wave, AXIS, "inverse", PATH_ROOM) is None


def test_the_same_corners_are_rounded_alike_whatever_the_path_is_called(tmp_path):
    turns = np.arange(81) / 2
    once = streamed(tmp_path, turns / 50, 20 + 30 * (np.arange(81) % 2))
    again = streamed(tmp_path, turns[:-1] / 50, 20 + 30 * (np.arange(80) % 2), "again.csv", at="@1.25Hz")
    of_each = [rounding_s(AXIS, one, "inverse") for one in (parse_wave("triangle:30um@50Hz"), once, again)]
    assert of_each == pytest.approx([of_each[0]] * 3, rel=0.03)


def test_points_of_a_rounded_path_are_a_tick_apart(tmp_path):
    """They were as far apart as rows that lie on them allow: eight ticks, four times what a corner is rounded over."""
    wave = streamed(tmp_path, [0.0, 0.016, 0.032, 0.048], [20, 60, 20, 60], at="@15.625Hz")
    (played,) = followed({"x": wave}, STAGE, "measured", "inverse").values()
    assert wave.log2 > 0
    assert played.log2 == 0
    assert 0 < played.rounding_s < 0.001


def driven(tmp_path, wave, **asked):
    virtual_stage(STAGE).save(tmp_path / "stage.toml", overwrite=True)
    with pl.connect(f"sim://{tmp_path}/stage.toml") as dev, pytest.warns(UserWarning, match="rounded"):
        return dev.track(wave, mode="inverse", model=STAGE, **asked)


@pytest.mark.parametrize(("ramp_s", "begin_s", "end_s"), [(0.002, 0.5, 1.0), (0.002, 3.2, 4.0)])
def test_a_rounded_corner_is_followed_as_was_said(tmp_path, ramp_s, begin_s, end_s):
    """Cut off it was 8 um off, of 20, for tens of milliseconds. What lay after 2 s was not rehearsed."""
    wave = corner(tmp_path, ramp_s, begin_s=begin_s, end_s=end_s)
    run = driven(tmp_path, wave)
    said = run.figures["predicted"]
    assert run.figures["max_um"] == pytest.approx(said["max_um"], rel=0.1)
    assert said["max_um"] < 2
    after = run.t_s > begin_s + ramp_s + 0.01
    assert np.abs(wave.value(run.t_s) - run.true_um["x"])[after].max() < 0.2
    rate_V_per_s = np.abs(np.diff(run.recording.axes["x"].u_V)).max() * 5000
    assert 0.5 * PATH_ROOM * SLEW_V_per_s < rate_V_per_s < SLEW_V_per_s


def test_the_hardest_part_of_a_long_path_is_rehearsed(tmp_path):
    wave = corner(tmp_path, 0.002, begin_s=5.0, end_s=9.0)
    asked = followed({"x": wave}, STAGE, "true", "inverse")
    (said,) = rehearse(asked, "inverse", STAGE, GAINS).values()
    assert said.from_s < 5.0 < said.from_s + said.first_s
    assert said.max_um > asked["x"].unplayed / 2
    assert said.max_pct == pytest.approx(100 * said.max_um / 20)
    assert said.sentence("x").endswith(f", in the 2 s from {said.from_s:.4g} s on")


@pytest.mark.parametrize("kind", ["path", "file"])
def test_a_jump_is_refused_in_every_kind_of_path_and_nothing_has_moved(tmp_path, kind):
    """In file: it was rounded over 4 ms and left by half of its height."""
    rows = tmp_path / "saw.csv"
    np.savetxt(rows, 20 + 30 * np.arange(1000) / 999, header="x_um", comments="")
    with pl.connect() as dev:
        with pytest.raises(BadInput, match=r"it goes at \d+ um/s; .* times as slow \(at .* Hz\) it works") as caught:
            dev.track(f"{kind}:{rows}@10Hz", mode="inverse", model=STAGE)
        assert dev.device.status().state == "parked"
        assert dev.device.status().model_crc == "00000000"
        assert np.ptp(dev.device.status().dac_codes) == 0
    slower_Hz = float(re.search(r"at ([\d.]+) Hz", str(caught.value))[1])
    assert accepted(parse_wave(f"{kind}:{rows}@{0.99 * slower_Hz}Hz"))


def test_corners_that_no_rounding_helps_are_refused_unless_forced(tmp_path):
    """Six strokes of 40 um, back to back, at nearly all that the slew limit lets a stage of 85 Hz."""
    stage = built_in("x500").model_copy(update={"cross_coupling": None})
    turns_s = 0.5 + np.arange(7) * 0.00203
    wave = streamed(tmp_path, [0, *turns_s, 1], [50, 50, 90, 50, 90, 50, 90, 50, 50])
    asked = followed({"x": wave}, stage, "true", "inverse")
    with pytest.raises(BadInput, match=r"ask for \d+ V/s at 0\.5\d* s, the output does .*; or --force") as caught:
        rehearse(asked, "inverse", stage, {})
    times = float(re.search(r"or ([\d.]+) times as long as a whole", str(caught.value))[1])
    assert beyond_slew(wave.scaled(time=times), stage.axes["x"], "inverse") is None
    with pl.connect("sim://x500") as dev:
        with pytest.raises(BadInput, match="rounding them does not help"):
            dev.track(wave, mode="inverse", model=stage)
        assert dev.device.status().state == "parked"
        with pytest.warns(UserWarning, match="left by up to"):
            assert dev.track(wave, mode="inverse", model=stage, force=True).figures["max_um"] > 1


def test_moves_volts_and_squares_have_rules_of_their_own():
    for text in ("goto:120um", "step:5um", "square:60um@50Hz"):
        refuse_path_too_fast("x", parse_wave(text), AXIS, "pid")
    refuse_path_too_fast("x", parse_wave("triangle:5V@500Hz"), AXIS, "open")


@pytest.mark.parametrize("text", ["chirp:60um@1..400Hz", "triangle:60um@400Hz", "sine:60um@400Hz", "goto:60um@0.01s"])
def test_slower_is_the_same_path_in_more_time(text):
    wave = parse_wave(text)
    after, shares = wave.scaled(time=2.5, swing=0.5), np.linspace(0, 1, 300, endpoint=False)
    asked = wave.offset + 0.5 * (wave.value(shares * wave.duration_s) - wave.offset)
    assert after.value(shares * after.duration_s) == pytest.approx(asked, abs=1e-6)
    assert after.duration_s == pytest.approx(2.5 * wave.duration_s)


def test_how_much_slower_is_found_to_a_hundredth():
    wave = parse_wave("sine:60um@100Hz")
    times = times_slower(wave, lambda tried, _spans_s: 0.0 if tried.f_Hz > 37.0 else None)
    assert 100 / 37 <= times <= 1.02 * 100 / 37
    assert times_slower(wave, lambda _tried, _spans_s: 0.0) is None


def test_without_a_mode_nothing_is_known_of_corners(tmp_path):
    stiff = AXIS.model_copy(update={"effects": ()})
    wave = corner(tmp_path, 0.001)
    assert rounding_s(stiff, wave, "inverse") == 0
    refuse_voltage_too_fast("x", wave, stiff, "inverse")


@pytest.fixture
def worked_out(monkeypatch):
    """How many values of paths were worked out, a call each."""
    counts, shares = [], Streamed._shares

    def counted(self, t_s):
        counts.append(len(t_s))
        return shares(self, t_s)

    monkeypatch.setattr(Streamed, "_shares", counted)
    return counts


def strokes(folder, seconds, ramp_s):
    """There and back, a corner every half second."""
    begins_s = np.arange(0.25, seconds, 0.5)
    t_s = np.ravel(np.column_stack([begins_s, begins_s + ramp_s]))
    x_um = np.ravel([[50 + 20 * (at % 2), 50 + 20 * ((at + 1) % 2)] for at in range(len(begins_s))])
    return streamed(folder, [0, *t_s, seconds], [50, *x_um, x_um[-1]])


def test_what_a_path_asks_of_the_output_is_worked_out_once(tmp_path, worked_out):
    """In warnings, in what is played and in the rehearsal it was worked out anew, seconds each of a long one."""
    wave = strokes(tmp_path, 10, 0.002)
    first = followed({"x": wave}, STAGE, "measured", "inverse")["x"].rounding_s
    at_first = sum(worked_out)
    worked_out.clear()
    assert followed({"x": wave}, STAGE, "true", "inverse")["x"].rounding_s == first > 0
    assert worked_out == []
    assert hardest(wave, STAGE.axes["x"], "inverse")[0] <= 1
    assert sum(worked_out) < at_first / 10  # parts without corners, which had not been rounded yet


def test_a_slower_one_is_looked_for_where_the_path_is_hard(tmp_path, worked_out):
    """Every try was of the whole, and they are ever longer: a scan of hours seemed to hang."""
    wave = strokes(tmp_path, 20, 0.00005)
    with pytest.raises(BadInput, match="times as long as a whole") as refusal:
        refuse_path_too_fast("x", wave, AXIS, "inverse")
    asked = sum(worked_out)
    times = float(re.search(r"or ([\d.]+) times as long as a whole", str(refusal.value))[1])
    worked_out.clear()
    assert accepted(wave.scaled(time=times))
    assert asked < 1.8 * sum(worked_out)
    assert not accepted(wave.scaled(time=times / 1.5))
