"""Paths are entered from where the axis stands and left where they end, without a kick."""

import numpy as np
import pytest

from phaselead.control import gains_of
from phaselead.control.joins import enter_s, quiet_s
from phaselead.control.tracking import track
from phaselead.device import Device, Standing
from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.sim import built_in
from phaselead.waveforms.catalogue import parse_wave

AXIS = AxisModel(
    time=TimeView(gain_um_per_V=15.0, delay_s=0.0003, u_range_V=(-2.0, 10.0), rate_Hz=5000.0),
    effects=(AdoptedEffect(name="resonance", params={"f_Hz": 200.0, "zeta": 0.02}),),
)
STAGE = built_in("xyz250")
GAINS = {axis: gains_of(None, STAGE, axis) for axis in "xy"}


def tracked(wave, mode, duration_s=0.5):
    with Device.open("sim://xyz250") as device:
        return track(device, wave, mode, stage=STAGE, gains=GAINS, duration_s=duration_s)


def outputs_V(run, axis="x"):
    """Of the whole stream: from before the path to after the park."""
    return (run.capture.axes[axis].dac.astype(float) - 32768) / 3200


@pytest.mark.parametrize("mode", ["pid", "inverse", "inverse+pid"])
@pytest.mark.parametrize("wave", ["sine:10um+100um@5Hz", "triangle:10um+100um@5Hz"])
def test_an_offset_is_reached_before_the_path_begins(mode, wave):
    """It jumped by 100 um at 1000 V/s."""
    run = tracked({"x": parse_wave(wave)}, mode)
    assert np.abs(np.diff(outputs_V(run))).max() * 5000 < 400  # of 1000 V/s
    assert abs(run.recording.x_um[0] - 100) < 5
    assert run.figures["from_rest"]["max_um"] < 10


@pytest.mark.parametrize("mode", ["inverse", "inverse+pid"])
def test_a_fast_path_is_entered_without_ringing(mode):
    """30 um at 100 Hz from rest left 7 %: now as little as in the steady state, and a third."""
    figures = tracked({"x": parse_wave("sine:30um@100Hz")}, mode).figures
    assert figures["from_rest"]["max_um"] < 1.33 * figures["max_um"]


def test_a_path_that_ends_in_mid_slope_is_left_gently():
    """A 60 um 20 Hz sine ended so kicked by 299 codes."""
    run = tracked({"x": parse_wave("sine:60um@20Hz")}, "inverse+pid", duration_s=0.5125)
    u_V, tick = outputs_V(run), run.capture.ticks
    end = int(np.searchsorted(tick, run.capture.end_tick))
    path = np.abs(np.diff(u_V[end - 1000 : end])).max()
    assert np.abs(np.diff(u_V[end - 2 : end + 100])).max() < 1.2 * path


@pytest.mark.parametrize("mode", ["inverse", "inverse+pid"])
def test_coupled_axes_begin_away_from_0_V_without_a_step(mode, tmp_path):
    """The join did not know of what the others cause: in mode inverse they stepped, at 1000 V/s."""
    limits = {"u_park_V": 5.0}
    axes = {
        name: axis.model_copy(update={"limits": axis.limits.model_copy(update=limits)})
        for name, axis in STAGE.axes.items()
    }
    coupling = ((1.0, 0.03, -0.02), (0.04, 1.0, 0.03), (-0.02, 0.05, 1.0))
    stage = STAGE.model_copy(update={"axes": axes, "cross_coupling": coupling})
    stage.save(tmp_path / "coupled.toml", overwrite=True)
    gains = {axis: gains_of(None, stage, axis) for axis in "xyz"}
    with Device.open(f"sim://{tmp_path / 'coupled.toml'}") as device:
        waves = {axis: parse_wave("sine:10um+100um@5Hz") for axis in "xyz"}
        for _ in range(2):  # the first run leaves them parked at 5 V
            run = track(device, waves, mode, stage=stage, gains=gains, duration_s=0.5)
    for axis in "xyz":
        u_V = outputs_V(run, axis)
        assert u_V.min() > 1
        assert np.abs(np.diff(u_V)).max() * 5000 < 400  # of 1000 V/s


def test_two_axes_begin_together():
    """Their previews and their ways differ, and the record begins with both paths."""
    waves = {"x": parse_wave("sine:20um+50um@10Hz"), "y": parse_wave("sine:20um@10Hz")}
    run = tracked(waves, "inverse+pid", 0.4)
    for axis, wave in waves.items():
        assert np.abs(run.recording.axes[axis].r_um - wave.value(run.recording.t_s)).max() < 1e-3


def test_an_open_record_holds_the_way_to_an_offset():
    """It is what the memory of the stage is fitted from."""
    run = tracked({"x": parse_wave("sine:2V+5V@5Hz")}, "open", 0.4)
    assert abs(run.recording.axes["x"].u_V[0]) < 0.01
    assert np.abs(np.diff(outputs_V(run))).max() * 5000 < 110


def test_an_open_path_from_zero_begins_at_once():
    run = tracked({"x": parse_wave("sine:5V@5Hz")}, "open", 0.4)
    assert len(run.recording.t_s) == 2000


def test_a_move_that_was_asked_for_is_as_short_or_refused():
    """It was stretched to 50 ms without a word."""
    run = tracked({"x": parse_wave("goto:100um@0.01s")}, "inverse")
    r_um = run.recording.axes["x"].r_um
    moving = np.flatnonzero(np.abs(np.diff(r_um)) > 1e-3)
    assert 0.009 < (moving[-1] - moving[0]) / 5000 <= 0.01
    settled = np.flatnonzero(np.abs(run.recording.axes["x"].x_um - 100) > 0.1)[-1] + 1
    assert settled / 5000 <= 0.012
    with pytest.raises(BadInput, match="the shortest is"):
        tracked({"x": parse_wave("goto:100um@0.004s")}, "inverse")


def test_how_long():
    rest = Standing(u_V=0.0, x_um=0.0)
    sine = parse_wave("sine:60um@5Hz")
    assert quiet_s(AXIS) == pytest.approx(0.03, rel=0.1)
    assert quiet_s(None) == 0.05
    assert enter_s(sine, rest, "inverse", AXIS) == quiet_s(AXIS)
    assert enter_s(sine, Standing(9.0, 200.0), "pid", None) == pytest.approx(2 * 0.375, rel=0.01)
    assert enter_s(parse_wave("sine:5V@5Hz"), rest, "open", AXIS) == 0
    assert enter_s(parse_wave("sine:5V+4V@5Hz"), rest, "open", None) == pytest.approx(0.15)
