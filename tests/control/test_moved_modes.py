"""Modes that have moved: the first trial tells where they are, and the table comes with the inverse of that."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_mode_model import AXIS, STAGE, VIEW

import phaselead as pl
from phaselead.control.feedback_loop import plant_response
from phaselead.control.gains import MODE_SHIFT, design_gains
from phaselead.control.learning import drive
from phaselead.control.learning import trials as course
from phaselead.control.learning.learned import load_learned
from phaselead.control.learning.moved_modes import Moved, moved_modes, stage_with_modes_at, with_modes_at
from phaselead.control.learning.response import model_response
from phaselead.control.learning.trials import learn
from phaselead.device.capture import DeviceFault
from phaselead.device.device import Device
from phaselead.device.encode_model import device_model
from phaselead.errors import BadInput
from phaselead.model import respond, rest_plays, small_signal
from phaselead.model.axis import AdoptedEffect, AxisModel
from phaselead.model.stage_file import Stage
from phaselead.waveforms.catalogue import parse_wave

GAINS = {"x": design_gains("x", AXIS)}
WAVE = "sine:5um@200Hz"


def positions(f_Hz, factor, gain, seed, swing_V=1.0, noise_um=0.01):
    """What a stage of the model's operator shows of a sine in the voltage, with its gain and modes elsewhere."""
    t_s = np.arange(5000) / 5000
    u_V = 3.0 + swing_V / 2 * np.cos(2 * np.pi * f_Hz * t_s)
    still = respond(VIEW, u_V, rest_plays(VIEW))[0]
    spectrum, line_Hz = np.fft.rfft(still), np.fft.rfftfreq(5000, 1 / 5000)
    spectrum[1:] *= gain * plant_response(small_signal(AXIS).with_modes_at(factor), line_Hz[1:])
    return t_s, u_V, np.fft.irfft(spectrum, 5000) + np.random.default_rng(seed).normal(0, noise_um, 5000)


@settings(max_examples=25, deadline=None)
@given(
    f_Hz=st.sampled_from([40.0, 125.0, 160.0, 200.0, 250.0]),
    factor=st.floats(0.85, 1.15),
    gain=st.floats(0.9, 1.1),
    seed=st.integers(0, 99),
)
def test_modes_are_where_they_are_said_to_be(f_Hz, factor, gain, seed):
    """Within four of the deviations that are told; up to 15 % off are three of what is known before."""
    found = moved_modes(AXIS, *positions(f_Hz, factor, gain, seed), f_Hz, 2, 5000)
    assert abs(found.factor - factor) < 4 * found.deviation


@pytest.mark.parametrize(("f_Hz", "tells"), [(5.0, False), (40.0, False), (180.0, True), (200.0, True)])
def test_a_path_far_below_the_modes_does_not_tell_where_they_are(f_Hz, tells):
    found = moved_modes(AXIS, *positions(f_Hz, 0.9, 1.0, 1), f_Hz, 2, 5000)
    assert found.surely is tells
    assert tells or found.deviation > 0.04


def test_a_path_that_converges_by_the_model_as_it_is_keeps_its_inverse():
    """At three quarters of the mode its response is a quarter off, which trials put right. A new inverse costs one."""
    found = moved_modes(AXIS, *positions(150.0, 0.87, 1.0, 1), 150.0, 2, 5000)
    assert found.factor < 1 - 2 * found.deviation
    assert not found.surely


@pytest.mark.parametrize("f_Hz", [100.0, 180.0, 200.0, 220.0])
def test_modes_that_have_not_moved_are_left(f_Hz):
    assert not moved_modes(AXIS, *positions(f_Hz, 1.0, 1.0, 2), f_Hz, 2, 5000).surely


def test_modes_that_are_known_leave_less_in_doubt():
    f_Hz = 50.0 * np.arange(12)
    less, more = (model_response(AXIS, GAINS["x"], f_Hz, mode_shift=shift).deviation for shift in (0.02, 0.1))
    assert (less <= 1.01 * more)[1:].all()
    assert less[3] < more[3] / 1.5


def test_a_model_without_a_mode_has_none_to_move():
    bare = AXIS.model_copy(update={"effects": ()})
    assert not moved_modes(bare, *positions(200.0, 0.9, 1.0, 3), 200.0, 2, 5000).surely


def test_every_mode_of_a_stage_moves_and_nothing_else():
    two = AdoptedEffect(name="resonance", params={"c": (0.9, 0.1), "f_Hz": (200.0, 600.0), "zeta": (0.02, 0.01)})
    lag = AdoptedEffect(name="sensor_lowpass", params={"corner_Hz": 2000.0})
    model = AXIS.model_copy(update={"effects": (two, lag)})
    moved = with_modes_at(model, 0.5)
    assert small_signal(moved).modes == ((0.9, 100.0, 0.02), (0.1, 300.0, 0.01))
    assert moved.effects[1] == lag
    assert moved.model_copy(update={"effects": model.effects}) == model
    assert stage_with_modes_at(STAGE, {"x": 1.0}) is STAGE
    assert stage_with_modes_at(STAGE, {"x": 0.5}).sha256 != STAGE.sha256


@pytest.fixture(scope="module")
def url(tmp_path_factory):
    """A stage with 10 % less gain, and a mode 10 % lower, than the model has."""
    view = VIEW.model_copy(update={"gain_um_per_V": 13.5, "play_w_um_per_V": (2.7, 2.7), "delay_s": 0.0001})
    mode = AdoptedEffect(name="resonance", params={"f_Hz": 180.0, "zeta": 0.02})
    lag = AdoptedEffect(name="sensor_lowpass", params={"corner_Hz": 2000.0})
    path = tmp_path_factory.mktemp("stage") / "stage.toml"
    Stage(name="stage", axes={"x": AxisModel(time=view, effects=(mode, lag))}).save(path, overwrite=True)
    return f"sim://{path}?seed=21"


def learned_on(url, trials=8, wave=WAVE, **options):
    with Device.open(url) as device:
        return learn(device, {"x": parse_wave(wave)}, stage=STAGE, gains=GAINS, trials=trials, **options)


@pytest.fixture(scope="module")
def table(url):
    return learned_on(url, turn_down=True)


def test_a_path_at_a_mode_that_has_moved_is_learned(table):
    """Less feedback was out of reach: the inverse of the old mode asked for it by references far beyond the sensor."""
    assert table.paths["x"].modes == pytest.approx(0.9, abs=0.02)
    assert "; the mode of x is at 1" in table.reason
    assert "instead of 200 Hz" in table.reason
    assert table.best.judged_pct < table.trials[0].judged_pct / 100
    assert table.gains()["x"].ki_V_per_um_s < GAINS["x"].ki_V_per_um_s


def test_the_table_is_played_with_the_inverse_it_was_learned_with(url, table, tmp_path):
    table.save(tmp_path / "learned.h5", overwrite=True)
    again = load_learned(tmp_path / "learned.h5")
    assert again.paths["x"].modes == table.paths["x"].modes
    with pl.connect(url) as device:
        run = device.track(WAVE, model=STAGE, learned=again, duration=1)
        assert run.figures["max_pct"] < 2
        assert device.device.holds(device_model(STAGE))  # the model that was given is there again
        with pytest.raises(BadInput, match="with its modes moved"):
            device.track(WAVE, learned=again, duration=1)


def test_learning_leaves_the_model_that_was_given(url):
    with Device.open(url) as device:
        learn(device, {"x": parse_wave(WAVE)}, stage=STAGE, gains=GAINS, trials=1)
        assert device.holds(device_model(STAGE))


def test_the_first_trial_leaves_the_modes_less_in_doubt(monkeypatch, url):
    doubts, responds = [], course.model_response

    def noted(axis, gains, f_Hz, turns, mode_shift):
        doubts.append(mode_shift)
        return responds(axis, gains, f_Hz, turns, mode_shift)

    monkeypatch.setattr(course, "model_response", noted)
    learned_on(url, 1)
    assert doubts[0] == MODE_SHIFT
    assert doubts[-1] < MODE_SHIFT / 2


def says(monkeypatch, factor):
    monkeypatch.setattr(drive, "moved_modes", lambda *arguments: Moved(factor, 1e-3, 1.0))


def test_an_inverse_that_does_not_help_is_dropped(monkeypatch, url):
    says(monkeypatch, 1.15)
    found = learned_on(url, 3, "sine:5um@120Hz")
    assert found.paths["x"].modes == 1.0
    assert "the mode of x" not in found.reason
    assert [trial.kept for trial in found.trials[:3]] == [True, False, True]


def test_modes_whose_loop_has_no_margin_are_not_believed(monkeypatch, url):
    says(monkeypatch, 0.4)
    refused = []
    monkeypatch.setattr(course, "loop_warnings", lambda stage, *rest, **options: _refuse_moved(stage, refused))
    found = learned_on(url, 2, "sine:5um@120Hz")
    assert refused
    assert found.paths["x"].modes == 1.0
    assert found.best.number > 0


def _refuse_moved(stage, refused):
    if stage != STAGE:
        refused.append(stage)
        raise BadInput("x: peak sensitivity 9")
    return []


def test_a_fault_with_the_new_inverse_keeps_what_there_was(monkeypatch, url):
    looks = drive.Drive.look

    def faulted(self, correction, steps, gains):
        if self.modes["x"] != 1:
            raise DeviceFault("fault adc_rail on axis x", None)
        return looks(self, correction, steps, gains)

    monkeypatch.setattr(drive.Drive, "look", faulted)
    found = learned_on(url)
    assert "adc_rail" in found.reason
    assert (len(found.trials), found.best.number, found.paths["x"].modes) == (1, 0, 1.0)


def test_a_table_of_before_has_the_modes_of_its_model(table, tmp_path):
    import h5py

    table.save(tmp_path / "learned.h5", overwrite=True)
    with h5py.File(tmp_path / "learned.h5", "r+") as file:
        file.attrs["version"] = 1
        del file["x"].attrs["modes"]
    assert load_learned(tmp_path / "learned.h5").paths["x"].modes == 1.0
    with h5py.File(tmp_path / "learned.h5", "r+") as file:
        file["x"].attrs["modes"] = 0.0
    with pytest.raises(BadInput, match="no table of this version"):
        load_learned(tmp_path / "learned.h5")
