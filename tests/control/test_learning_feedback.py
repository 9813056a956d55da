"""How much feedback is kept while a path is learned."""

import numpy as np
import pytest
from learned_paths import GAINS, SINE, learned_with
from one_mode_model import AXIS, STAGE

from phaselead.control.feedback_loop import open_loop
from phaselead.control.learning import drive
from phaselead.control.learning import trials as course
from phaselead.control.learning.look import Look
from phaselead.control.learning.quieter import LEFT_OF_DRIFT, louder, quieter, scaled, share_of
from phaselead.control.learning.trials import learn
from phaselead.control.tracking import track
from phaselead.device.device import Device
from phaselead.errors import BadInput
from phaselead.model import small_signal
from phaselead.model.axis import Gains, Sensor


def test_feedback_is_turned_down_as_far_as_drift_allows():
    """Longer trials tell slower drift, so that less feedback will do."""
    own, plant = GAINS["x"], small_signal(AXIS)
    shares = []
    for seen_s in (0.1, 1.0, 10.0):
        found = quieter(AXIS, own, seen_s)
        shares.append(found.ki_V_per_um_s / own.ki_V_per_um_s)
        slow = np.abs(1 / (1 + open_loop(plant, found, np.array([1 / seen_s])))).max()
        assert slow <= LEFT_OF_DRIFT or found == own
    assert shares == sorted(shares, reverse=True)
    assert shares[0] == 1
    assert shares[-1] == 0.25


def test_gains_of_one_kind_alone_are_learned_with(unlike_model, tmp_path):
    """Without an integral part the share of the feedback was a division by zero, after all trials were driven."""
    unlike_model.save(tmp_path / "stage.toml", overwrite=True)
    proportional = Gains(kp_V_per_um=0.0005, ki_V_per_um_s=0.0, kd_V_s_per_um=0.0)
    with Device.open(f"sim://{tmp_path / 'stage.toml'}") as device:
        gains = {"x": proportional}
        found = learn(device, {"x": SINE}, stage=STAGE, gains=gains, trials=1, turn_down=True, force=True)
    assert len(found.trials) == 2
    assert found.gains() == gains
    assert share_of(scaled(proportional, 0.5), proportional) == 0.5
    assert share_of(scaled(proportional, 0.0), scaled(proportional, 0.0)) == 1


def test_a_path_is_learned_with_less_feedback_and_the_table_says_so(unlike_model, tmp_path):
    """The noise of the sensor, which the loop makes a motion of, was most of what was left."""
    found = learned_with(unlike_model, tmp_path)
    own = found.gains()["x"]
    assert own.ki_V_per_um_s == 0.25 * GAINS["x"].ki_V_per_um_s
    assert own.kd_V_s_per_um == 0.25 * GAINS["x"].kd_V_s_per_um
    assert "; x keeps 25 % of its gains: what repeats is learned" in found.reason
    assert (
        found.trials[1].rms_um["x"] < found.trials[0].rms_um["x"] / 2
    )  # what less feedback leaves is known beforehand
    with pytest.raises(BadInput, match="learned table is for the gains"):
        found.waveforms({"x": SINE}, STAGE.sha256, found.mode, GAINS)
    path = tmp_path / "stage.toml"
    shaken = {}
    for name, gains in (("all", GAINS), ("quarter", found.gains())):
        with Device.open(f"sim://{path}") as device:
            run = track(device, {"x": SINE}, found.mode, stage=STAGE, gains=gains, duration_s=2.0, force=True)
        off_um = (SINE.value(run.t_s) - run.true_um["x"])[-5000:].reshape(-1, 250)
        shaken[name] = (off_um - off_um.mean(axis=0)).std()
    assert shaken["quarter"] < shaken["all"]
    assert found.best.rms_um["x"] < found.trials[0].rms_um["x"] / 3


def test_all_feedback_is_kept_where_less_leaves_more(monkeypatch, unlike_model, tmp_path):
    monkeypatch.setattr(course, "larger", lambda after, before: True)
    found = learned_with(unlike_model, tmp_path)
    assert found.gains() == GAINS
    assert "gains" not in found.reason
    assert found.best.rms_um["x"] < found.trials[0].rms_um["x"] / 3


def refused_below(monkeypatch, share):
    """Every correction with less than ``share`` of the feedback is refused, but for the first."""
    corrected = drive.Drive.corrected

    def refused(self, correction, steps, gains):
        if gains["x"].ki_V_per_um_s < share * GAINS["x"].ki_V_per_um_s and len(self.trials) > 1:
            raise drive.TooLarge("x: it would add 100 um")
        return corrected(self, correction, steps, gains)

    monkeypatch.setattr(drive.Drive, "corrected", refused)
    monkeypatch.setattr(Look, "mostly_repeats", True)


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_feedback_comes_back_as_far_as_less_of_it_cannot_reach_a_line(monkeypatch, share, unlike_model, tmp_path):
    """A path at a mode that the model has 10 % off was left at 29 % of its swing."""
    refused_below(monkeypatch, share)
    found = learned_with(unlike_model, tmp_path)
    assert found.gains() == {"x": GAINS["x"] if share == 1 else scaled(GAINS["x"], share)}
    assert len(found.trials) > 3
    assert found.best.rms_um["x"] < found.trials[1].rms_um["x"]


def test_feedback_stays_down_where_more_of_it_would_not_reach_further(monkeypatch, unlike_model, tmp_path):
    """Learned to 0.06 %, a triangle was begun anew with all of its feedback, for lines that no loop reaches."""
    judges, driven = drive.Drive._judged, []

    def with_more_at_the_highest_line(self, *arguments):
        look = judges(self, *arguments)
        look.error["x"].amplitude[-1] += 1.0
        driven.append(look.gains["x"].ki_V_per_um_s / GAINS["x"].ki_V_per_um_s)
        assert look.mostly_repeats
        return look

    monkeypatch.setattr(drive.Drive, "_judged", with_more_at_the_highest_line)
    found = learned_with(unlike_model, tmp_path, trials=12)
    assert "as asked" not in found.reason
    assert set(driven[1:]) == {0.25}


def test_a_first_correction_with_less_feedback_that_does_harm_is_taken_back(monkeypatch, unlike_model, tmp_path):
    """A probe of 0.1 um at a mode that the model lacks made 2 um, and everything after it went on from there."""
    corrections, looks = [], drive.Drive.look

    def harmed(self, correction, steps, gains):
        look = looks(self, correction, steps, gains)
        corrections.append(correction["x"])
        if len(corrections) == 2:
            look.error["x"].amplitude[3] += 20.0
        return look

    monkeypatch.setattr(drive.Drive, "look", harmed)
    found = learned_with(unlike_model, tmp_path)
    assert found.gains()["x"].ki_V_per_um_s == 0.25 * GAINS["x"].ki_V_per_um_s
    assert np.abs(corrections[2]).sum() < 0.75 * np.abs(corrections[1]).sum()  # half of the step, from where it began


def test_feedback_is_doubled_and_never_more_than_asked_for():
    own = GAINS["x"]
    assert louder(scaled(own, 0.25), own) == scaled(own, 0.5)
    assert louder(scaled(own, 0.5), own) == louder(own, own) == own
    proportional = Gains(kp_V_per_um=0.0005, ki_V_per_um_s=0.0, kd_V_s_per_um=0.0)
    assert louder(scaled(proportional, 0.25), proportional) == scaled(proportional, 0.5)
    none = scaled(proportional, 0.0)
    assert louder(none, none) == none


def test_where_noise_is_left_feedback_goes_down_further_at_the_same_voltage(unlike_model, tmp_path):
    """30 um at 50 Hz on a stage with 10 % less gain was left with 8 nm rms of noise, 3.4 with a sixteenth. Here the
    sensor has twice the usual noise, so that what is left is clearly that."""
    axis = unlike_model.axes["x"]
    noisy = axis.model_copy(update={"sensor": Sensor(noise_um_rms=2 * axis.sensor.noise_um_rms)})
    found = learned_with(unlike_model.model_copy(update={"axes": {"x": noisy}}), tmp_path, trials=10)
    own = found.gains()["x"]
    assert own.ki_V_per_um_s < 0.25 * GAINS["x"].ki_V_per_um_s
    assert found.best.rms_um["x"] < found.trials[0].rms_um["x"] / 3


@pytest.mark.parametrize(("quiet", "times"), [(True, 2), (False, 1)])
def test_feedback_that_leaves_no_less_noise_is_not_gone_on_with(monkeypatch, quiet, times, unlike_model, tmp_path):
    learns, begun = course._Course._learn, []

    def counted(self, base, *arguments):
        begun.append(base.gains["x"])
        return learns(self, base, *arguments)

    monkeypatch.setattr(course._Course, "_learn", counted)
    monkeypatch.setattr(Look, "rests_less_than", lambda self, other: quiet)
    learned_with(unlike_model, tmp_path, trials=10)
    assert len(begun) == times
