"""Learning on a simulated device: the error of what is learned shrinks, and what does not is taken back."""

import json
import re
from itertools import pairwise

import numpy as np
import pytest
from learned_paths import GAINS, SINE, learned_with
from one_mode_model import STAGE

import phaselead as pl
from phaselead.control.feeding import send_points
from phaselead.control.kept_runs import KeptRuns
from phaselead.control.learning import drive
from phaselead.control.learning.learned import load_learned
from phaselead.control.learning.look import trial_seconds
from phaselead.control.learning.moved_modes import Moved
from phaselead.control.learning.trials import learn
from phaselead.control.tracking import track
from phaselead.device import Refused, device_model
from phaselead.device.capture import DeviceFault
from phaselead.device.device import Device
from phaselead.errors import BadInput
from phaselead.model.axis import Gains
from phaselead.waveforms.catalogue import parse_wave


@pytest.fixture(scope="module")
def outcome(unlike_model, tmp_path_factory):
    path = tmp_path_factory.mktemp("stage") / "stage.toml"
    unlike_model.save(path, overwrite=True)
    with Device.open(f"sim://{path}") as device:
        found = learn(device, {"x": SINE}, stage=STAGE, gains=GAINS, trials=5)
        run = track(
            device, found.waveforms({"x": SINE}, STAGE.sha256, found.mode, GAINS), found.mode, stage=STAGE, gains=GAINS
        )
    return found, run


def test_what_is_learned_is_several_times_better(outcome):
    """Of the true position, against the path as it was written."""
    found, run = outcome
    first, best = found.trials[0], found.best
    assert best.rms_um["x"] < first.rms_um["x"] / 3
    assert best.true_max_um["x"] < first.true_max_um["x"] / 3
    off_um = SINE.value(run.t_s) - run.true_um["x"]
    assert run.figures["true"]["max_um"] == np.abs(off_um[-1000:]).max()
    assert run.figures["true"]["max_um"] < 0.003 * SINE.swing


def test_the_device_itself_plays_it_for_its_path_mode_and_model_alone(outcome, unlike_model, tmp_path):
    """Whatever host asks: the table's identity is with its points."""
    found, _ = outcome
    played = found.waveforms({"x": SINE}, STAGE.sha256, found.mode, GAINS)["x"]
    asked = {"swing": played.swing, "offset": played.offset, "f_Hz": played.f_Hz}
    unlike_model.save(tmp_path / "stage.toml")

    def refused(mode=found.mode, **other):
        device.set_axis("x", mode)
        with pytest.raises(Refused, match="for another model, mode or path"):
            device.set_path("x", "wave", **asked | other)

    with Device.open(f"sim://{tmp_path}/stage.toml") as device:
        device.upload_if_other(device_model(STAGE))
        device.set_axis("x", found.mode)
        send_points(device, "x", played)
        device.set_path("x", "wave", **asked)
        refused(swing=played.swing + 0.001)
        refused(f_Hz=played.f_Hz * 1.0001)
        refused(mode="pid")
        device.set_axis("x", found.mode)
        device.set_path("x", "wave", **asked)
        device.upload_if_other(device_model(STAGE.model_copy(update={"name": "another"})))
        refused()


def test_what_is_kept_only_gets_better(outcome):
    found, _ = outcome
    kept = [trial.rms_um["x"] for trial in found.trials if trial.kept]
    assert kept[0] == found.trials[0].rms_um["x"]
    assert all(after < 1.1 * before for before, after in pairwise(kept))
    assert found.reason


def test_a_table_is_read_as_it_was_written(outcome, tmp_path):
    found, _ = outcome
    found.save(tmp_path / "learned.h5", overwrite=True)
    again = load_learned(tmp_path / "learned.h5")
    assert json.dumps(again.as_dict()) == json.dumps(found.as_dict())
    one, two = (table.waveforms({"x": SINE}, STAGE.sha256, found.mode, GAINS)["x"] for table in (found, again))
    assert (one.points == two.points).all()
    assert again.gains() == found.gains()
    assert found.plot().axes
    assert len(found.columns["trial"]) == len(found.trials)


@pytest.mark.parametrize(
    ("wave", "mode", "stage", "trials", "said"),
    [
        ("sine:30um@20Hz", "pid", STAGE, 3, "mode pid is not learned in"),
        ("goto:50um", "inverse", STAGE, 3, "staircase:50um/1@1Hz, there and back"),
        ("step:-5um", "inverse", STAGE, 3, "staircase:5um/1@1Hz"),
        ("goto:30um", "inverse+pid", STAGE, 3, "driven once"),
        ("sine:30um@20Hz", "inverse+pid", None, 3, "--model"),
        ("sine:30um@20Hz", "inverse+pid", STAGE, 0, "one or more"),
        ("sine:5V@5Hz", "inverse+pid", STAGE, 3, "micrometres"),
        ("sine:60um@300Hz", "inverse+pid", STAGE, 3, "on the model this ends in"),
    ],
)
def test_what_cannot_be_learned_is_refused_before_anything_moves(wave, mode, stage, trials, said):
    with Device.open("sim://xyz250") as device:
        with pytest.raises(BadInput, match=said):
            learn(device, {"x": parse_wave(wave)}, mode, stage=stage, gains=GAINS, trials=trials)
        assert device.status().state == "parked"


def test_what_a_refusal_of_a_single_drive_names_is_learned(tmp_path):
    """It said to write a move as a period, not how."""
    path = tmp_path / "scan.csv"
    path.write_text("t_s,x_um\n0,0\n0.05,10\n0.1,0\n")
    with pl.connect() as dev:
        for wave in ("goto:10um", f"path:{path}"):
            with pytest.raises(BadInput, match="driven once") as refusal:
                dev.learn(wave, model=STAGE, trials=1)
            named = re.search("repeat; (.+?),", str(refusal.value))[1].replace("FILE", str(path))
            assert len(dev.learn(named, model=STAGE, trials=1).trials) == 2


def test_a_later_fault_ends_it_with_the_best_trial_kept(monkeypatch, unlike_model, tmp_path):
    runs = []

    def driven(*arguments, **options):
        if len(runs) == 2:
            raise DeviceFault("fault adc_rail on axis x", runs[-1].capture)
        runs.append(track(*arguments, **options))
        return runs[-1]

    unlike_model.save(tmp_path / "stage.toml", overwrite=True)
    monkeypatch.setattr(drive, "track", driven)
    with Device.open(f"sim://{tmp_path / 'stage.toml'}") as device:
        found = learn(device, {"x": SINE}, stage=STAGE, gains=GAINS, trials=5)
    assert "adc_rail" in found.reason
    assert found.in_fault
    assert len(found.trials) == 2
    assert found.best == found.trials[1]


@pytest.mark.parametrize(("turn_down", "advice"), [(False, "lower the gains"), (True, "phaselead tune")])
def test_a_first_trial_that_runs_away_says_what_to_do(turn_down, advice):
    """As `track` and `move` do. The gains are stable with their derivative part alone."""
    unstable = {"x": Gains(kp_V_per_um=0.017, ki_V_per_um_s=8.62, kd_V_s_per_um=0.0)}
    with Device.open("sim://xyz250") as device, pytest.raises(DeviceFault) as fault:
        learn(device, {"x": SINE}, stage=STAGE, gains=unstable, trials=1, force=True, turn_down=turn_down)
    assert "the loop of x is unstable" in str(fault.value)
    assert advice in str(fault.value)


def test_what_trials_are_judged_by_is_shown(outcome):
    """The best is the one with the smallest figure, whatever largest error and rms of the whole run say."""
    found, _ = outcome
    judged = [trial.judged_pct for trial in found.trials]
    assert judged[found.best.number] == min(judged)
    shown = str(found)
    assert all(f"{one:.4f}" in shown for one in judged)
    assert f"trial {found.best.number} is kept: {judged[0]:.4f} -> {min(judged):.4f} %" in shown
    first = found.trials[0]
    swing_um = np.ptp(found.paths["x"].wanted_um)
    assert first.judged_pct == pytest.approx(100 * first.rms_um["x"] / swing_um, rel=0.2)


def test_a_response_that_the_model_has_wrong_is_found_out(monkeypatch, unlike_model, tmp_path):
    """At the model's mode, which the stage has 5 % lower, a path comes out turned round."""
    monkeypatch.setattr(Moved, "surely", False)  # else its inverse is put right
    unlike_model.save(tmp_path / "stage.toml", overwrite=True)
    with Device.open(f"sim://{tmp_path / 'stage.toml'}") as device:
        found = learn(device, {"x": parse_wave("sine:5um@200Hz")}, stage=STAGE, gains=GAINS, trials=6)
    assert found.trials[1].probed_lines["x"] > 0
    assert found.best.rms_um["x"] < found.trials[0].rms_um["x"] / 10


def test_a_trial_that_is_worse_leaves_no_trace(monkeypatch, unlike_model, tmp_path):
    unlike_model.save(tmp_path / "stage.toml", overwrite=True)
    tables = []
    for trials in (1, 2):
        runs = []

        def driven(device, waves, mode, runs=runs, **options):
            runs.append(track(device, waves, "pid" if len(runs) == 2 else mode, **options))
            return runs[-1]

        monkeypatch.setattr(drive, "track", driven)
        with Device.open(f"sim://{tmp_path / 'stage.toml'}") as device:
            tables.append(learn(device, {"x": SINE}, stage=STAGE, gains=GAINS, trials=trials))
    assert [trial.kept for trial in tables[1].trials] == [True, True, False]
    assert (tables[0].paths["x"].played_um == tables[1].paths["x"].played_um).all()


def test_a_correction_larger_than_allowed_is_not_driven(monkeypatch, unlike_model, tmp_path):
    unlike_model.save(tmp_path / "stage.toml", overwrite=True)
    monkeypatch.setattr(drive, "LARGEST_CORRECTION", 1e-4)
    with Device.open(f"sim://{tmp_path / 'stage.toml'}") as device:
        found = learn(device, {"x": SINE}, stage=STAGE, gains=GAINS, trials=3)
    assert "the model is not of this stage" in found.reason
    assert found.best == found.trials[0]


def test_trials_are_long_enough_to_settle_and_to_hear():
    waves = {"x": parse_wave("sine:1um@100Hz"), "y": parse_wave("sine:1um@0.5Hz")}
    assert trial_seconds({"x": waves["x"]}) == pytest.approx(1.5)
    assert trial_seconds(waves) == pytest.approx(20.0)


def test_half_of_a_step_is_tried_where_the_model_refuses_all_of_it(monkeypatch, unlike_model, tmp_path):
    """One refusal of a rehearsal ended it, and what had been learned was begun anew with more feedback."""
    changes, rehearses = [], drive.rehearse

    def once_refused(waves, *arguments):
        changes.append(waves["x"].played - changes[0] if changes else waves["x"].played)
        if len(changes) == 3:
            raise BadInput("x: on the model this is cut")
        rehearses(waves, *arguments)

    monkeypatch.setattr(drive, "rehearse", once_refused)
    unlike_model.save(tmp_path / "stage.toml", overwrite=True)
    with Device.open(f"sim://{tmp_path / 'stage.toml'}") as device:
        found = learn(device, {"x": SINE}, stage=STAGE, gains=GAINS, trials=2)
    assert len(found.trials) == 3
    lines = slice(1, 8)  # in higher ones trial 1 may have been a probe, which is no part of what it learned
    first, refused, half = (np.fft.rfft(change)[lines] / 512 for change in changes[1:])
    assert np.abs(refused - first).max() > 1e-3
    assert half - first == pytest.approx((refused - first) / 2, abs=1e-6)


@pytest.mark.parametrize("number", [1, 2, 4])
def test_a_run_that_cannot_be_kept_is_said(monkeypatch, number, unlike_model, tmp_path):
    """It was taken for a step that the model refuses, and the trial after it for the same one."""

    class Full(KeptRuns):
        def add(self, name, run):
            if name == f"trial-{number}":
                raise BadInput("the disk is full")
            return super().add(name, run)

    with pytest.raises(BadInput, match="the disk is full"):
        learned_with(unlike_model, tmp_path, trials=10, kept=Full(None))
