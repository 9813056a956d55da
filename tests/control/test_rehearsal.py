"""Paths on the model before they are driven: what would end in a fault is refused while nothing has moved."""

import re
import warnings

import numpy as np
import pytest

import phaselead as pl
from phaselead.control.gains import design_gains
from phaselead.control.journal import track_to_file
from phaselead.control.motion_limits import rests_unseen
from phaselead.control.rehearsal import rehearse
from phaselead.control.tracking import check_path
from phaselead.device.device import Device
from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel, TableView, TimeView
from phaselead.model.stage_file import Stage
from phaselead.sim import virtual_stage
from phaselead.waveforms.catalogue import parse_wave
from phaselead.waveforms.replaced import Replaced

AXIS = AxisModel(
    time=TimeView(
        gain_um_per_V=15.0, play_r_V=(0.2, 1.0), play_w_um_per_V=(3.0, 3.0), delay_s=0.0003, u_range_V=(-2.0, 10.0),
        rate_Hz=5000.0,
    ),
    effects=(AdoptedEffect(name="resonance", params={"f_Hz": 200.0, "zeta": 0.02}),),
)  # fmt: skip
STAGE = Stage(name="model", axes={"x": AXIS})
GAINS = {"x": design_gains("x", AXIS)}


def refusal(text, mode="inverse+pid", stage=STAGE):
    with pytest.raises(BadInput) as caught:
        rehearse({"x": parse_wave(text)}, mode, stage, GAINS)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("wave", ["sine:60um@300Hz", "triangle:200um@100Hz"])
def test_a_path_that_is_far_too_fast_is_refused_with_what_works(wave):
    """These moved, then faulted."""
    line = refusal(wave)
    assert "on the model this " in line
    assert re.search("ends in fault|cut by the output's limits", line)
    kind, _, rate = re.split("[:@]", wave)
    swing_um = float(re.search(r"a swing of up to ([\d.]+) um", line)[1])
    rehearse({"x": parse_wave(f"{kind}:{0.99 * swing_um}um@{rate}")}, "inverse+pid", STAGE, GAINS)


def test_what_works_is_named_also_where_the_device_plays_what_a_late_sensor_is_to_show():
    """The path that was asked for stayed as large as it was, and nothing worked."""
    asked = parse_wave("sine:60um@300Hz")
    with pytest.raises(BadInput) as caught:
        rehearse({"x": Replaced.as_sensed(asked, 8e-5)}, "inverse+pid", STAGE, GAINS)
    swing_um = float(re.search(r"a swing of up to ([\d.]+) um", str(caught.value))[1])
    rehearse({"x": Replaced.as_sensed(asked.scaled(swing=0.99 * swing_um / 60), 8e-5)}, "inverse+pid", STAGE, GAINS)


@pytest.mark.parametrize("share", [0.1, 2.5])
def test_a_learned_table_is_scaled_with_the_path_that_it_is_for(share):
    asked = parse_wave("sine:20um+30um@50Hz")
    table = asked.value(np.arange(1024) / 1024 / 50) + 0.1 * np.sin(np.arange(1024))
    learned = Replaced.of(asked, table, trial_s=1.0)
    scaled = learned.scaled(swing=share)
    assert scaled.as_asked.swing == share * asked.swing
    assert scaled.played == pytest.approx(asked.offset + share * (learned.played - asked.offset))


@pytest.mark.parametrize("mode", ["pid", "inverse", "inverse+pid"])
@pytest.mark.parametrize("wave", ["sine:60um@5Hz", "sine:30um@100Hz", "triangle:60um@20Hz", "goto:120um"])
def test_what_the_stage_can_do_is_let_through(wave, mode):
    rehearse({"x": parse_wave(wave)}, mode, STAGE, GAINS)


@pytest.mark.parametrize(
    ("wave", "mode"), [("sine:60um@5Hz", "pid"), ("sine:30um@50Hz", "inverse"), ("goto:60um", "pid")]
)
def test_what_the_rehearsal_says_of_the_error_comes_true(tmp_path, wave, mode):
    """It said nothing of a path that it let through."""
    virtual_stage(STAGE).save(tmp_path / "stage.toml", overwrite=True)
    told = []
    with pl.connect(f"sim://{tmp_path}/stage.toml") as dev:
        run = dev.track(wave, mode=mode, model=STAGE, gains=(0, 15, 1e-5), on_rehearsed=told.append)
    (said,) = told
    assert said["x"].max_um == pytest.approx(run.figures["max_um"], rel=0.1)
    assert said["x"].rms_um == pytest.approx(run.figures["rms_um"], rel=0.1)
    assert run.figures["predicted"] == vars(said["x"])
    assert said["x"].sentence("x").startswith(f"x: on the model off by at most {said['x'].max_um:.3g} um (")


@pytest.mark.parametrize(("changed", "left_um", "said"), [(1.0, 0.02, False), (1.5, 0.02, True), (1.5, 0.0, False)])
def test_a_run_that_is_left_by_far_more_than_its_model_said_is_remarked_on(tmp_path, changed, left_um, said):
    """Of another stage, or one that has changed; a model that was fitted to nothing says nothing of its error."""
    view = AXIS.time.model_copy(update={"residual_um_rms": left_um})
    model = Stage(name="was", axes={"x": AXIS.model_copy(update={"time": view})})
    now = view.model_copy(update={"gain_um_per_V": changed * view.gain_um_per_V})
    virtual_stage(Stage(name="is", axes={"x": AXIS.model_copy(update={"time": now})})).save(tmp_path / "is.toml")
    with pl.connect(f"sim://{tmp_path}/is.toml") as dev, warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        run = dev.track("sine:10um@5Hz", mode="inverse", duration=0.6, model=model)
    lines = [str(one.message) for one in found if "where the model said" in str(one.message)]
    assert len(lines) == said
    if said:
        assert lines[0].startswith(f"x: off by up to {run.figures['max_um_mean_removed']:.3g} um about its mean")
        assert f"{run.figures['predicted']['max_um']:.3g} at most" in lines[0]


def test_each_axis_is_said_and_of_a_long_path_that_it_is_of_its_begin():
    stage = Stage(name="two", axes={"x": AXIS, "y": AXIS})
    with pl.connect() as dev:
        run = dev.track(x="sine:10um@5Hz", y="sine:5um@5Hz", mode="pid", gains=(0, 15, 1e-5), model=stage, duration=2.4)
    by_axis = {axis: figures["predicted"] for axis, figures in run.of_axes()}
    assert by_axis["x"]["max_um"] > by_axis["y"]["max_um"] > 0
    assert by_axis["x"]["first_s"] == 2.0
    assert (
        rehearse({"x": parse_wave("sine:10um@5Hz")}, "pid", STAGE, GAINS, 2.4)["x"]
        .sentence("x")
        .endswith(", in its first 2 s")
    )


def test_learning_says_it_of_the_first_trial_alone():
    told = []
    with pl.connect() as dev:
        dev.learn("sine:10um@50Hz", model=STAGE, gains=(0, 15, 1e-5), trials=1, on_rehearsed=told.append)
    assert len(told) == 1


def with_limits(**limits):
    return AXIS.model_copy(update={"limits": AXIS.limits.model_copy(update=limits)})


def test_a_longer_move_is_named_that_works():
    """The slower moves that were tried were all made at the usual speed, and none was named."""
    stage = Stage(name="strict", axes={"x": with_limits(error_um=0.5)})
    line = refusal("goto:120um", "pid", stage)
    seconds = float(re.search(r"a move of ([\d.]+) s or longer works", line)[1])
    assert seconds > parse_wave("goto:120um").duration_s
    rehearse({"x": parse_wave(f"goto:120um@{1.01 * seconds}s")}, "pid", stage, GAINS)
    swing_um = float(re.search(r"a swing of up to ([\d.]+) um", line)[1])
    rehearse({"x": parse_wave(f"goto:{0.99 * swing_um}um")}, "pid", stage, GAINS)


def test_what_the_tables_do_not_cover_does_not_work():
    """Below 8 Hz the mode refuses the path: that counted as a frequency that works."""
    table = TableView(
        swing_V=(1.0, 9.0), f_Hz=(8.0, 30.0), a_um_per_V=(18.0, 0.2, 0.0), b_deg=(0.0,) * 6, c_um=(0.0,) * 6
    )
    axis = with_limits(slew_V_per_s=100.0).model_copy(update={"table": table})
    line = refusal("sine:100um@25Hz", "ff", Stage(name="slow", axes={"x": axis}))
    assert re.search(r"a swing of up to [\d.]+ um works there", line)
    assert "or up to" not in line


def test_nothing_is_said_where_nothing_is_known():
    fast = {"x": parse_wave("sine:60um@300Hz")}
    assert rehearse(fast, "pid", None, {}) == {}
    assert rehearse(fast, "pid", Stage(name="bare", axes={"x": AxisModel()}), GAINS) == {}
    assert rehearse({"y": fast["x"]}, "pid", STAGE, {"y": GAINS["x"]}) == {}


def test_refused_means_not_moved_and_force_goes_on():
    path = {"x": parse_wave("triangle:200um@100Hz")}
    with Device.open("sim://xyz250") as device:
        with pytest.raises(BadInput):
            track_to_file(device, path, "inverse+pid", output=None, stage=STAGE, gains=GAINS)
        status = device.status()
        assert (status.state, status.model_crc) == ("parked", "00000000")
        run = track_to_file(device, path, "inverse+pid", output=None, stage=STAGE, gains=GAINS, force=True)
        assert device.status().model_crc != status.model_crc
        assert run.figures["max_pct"] > 10


@pytest.mark.parametrize("offset_um", [-124.6, 300.0])
def test_a_model_that_rests_where_its_sensor_does_not_see_is_told_so(offset_um):
    """A fit of positions that were not zeroed as the sensor is: it said that no path works, and to choose
    other gains."""
    time = AXIS.time.model_copy(update={"offset_um": offset_um})
    stage = Stage(name="far", axes={"x": AXIS.model_copy(update={"time": time})})
    line = refusal("sine:10um@1Hz", "pid", stage)
    assert f"it rests at {offset_um:g} um at 0 V, outside what its sensor sees (-10..270 um)" in line
    assert "gains" not in line


def test_a_path_that_leaves_what_the_sensor_sees_is_not_laid_to_the_model():
    line = refusal("sine:60um@300Hz")
    assert "adc_rail" in line
    assert "rests" not in line


def test_where_it_rests_is_by_the_safe_value():
    time = AXIS.time.model_copy(update={"offset_um": -100.0})
    assert "rests at -100 um at 0 V" in rests_unseen(AXIS.model_copy(update={"time": time}))
    assert rests_unseen(with_limits(u_park_V=10.0).model_copy(update={"time": time})) is None
    assert rests_unseen(AXIS) is None


@pytest.mark.parametrize(("mode", "other"), [("ff+pid", "inverse+pid"), ("ff", "inverse")])
def test_a_mode_without_its_tables_names_one_that_needs_none(mode, other):
    """It named pid, which leaves out all that a model with a time view alone has."""
    with pytest.raises(BadInput, match=re.escape(f"or use --mode {other}, which needs no tables")):
        check_path("x", parse_wave("sine:10um@1Hz"), mode, AXIS)
    check_path("x", parse_wave("sine:10um@1Hz"), other, AXIS)
    with pytest.raises(BadInput, match=re.escape("or use --mode pid, which needs no tables")):
        check_path("x", parse_wave("sine:10um@1Hz"), mode, AxisModel())


def test_a_move_on_a_model_that_rests_unseen_is_told_so_too():
    time = AXIS.time.model_copy(update={"offset_um": -124.6})
    stage = Stage(name="far", axes={"x": AXIS.model_copy(update={"time": time})})
    with pl.connect() as dev, pytest.raises(BadInput, match=r"on the model .*; x: it rests at -124.6 um") as caught:
        dev.move(x=50, model=stage)
    assert "gains" not in str(caught.value)


def test_a_model_that_the_simulator_cannot_play_is_said_to_be_untried():
    """It was driven without a word."""
    twice = AXIS.model_copy(update={"effects": (*AXIS.effects, *[AdoptedEffect(name="mains_hum")] * 2)})
    with pytest.warns(UserWarning, match=r"not tried on the model first: .*'mains_hum' stands there 2 times"):
        assert rehearse({"x": parse_wave("sine:10um@5Hz")}, "pid", Stage(name="s", axes={"x": twice}), GAINS) == {}


def test_the_share_of_a_part_is_of_the_whole_path():
    """2 s of a path of 5 s go 54 of its 60 um: 6.3 % of these were said where the run then said 5.7 %."""
    predicted = rehearse({"x": parse_wave("sine:60um@0.2Hz")}, "pid", STAGE, GAINS)["x"]
    assert predicted.first_s == 2.0
    assert predicted.max_pct == pytest.approx(100 * predicted.max_um / 60)
