"""learn and track --learned on the command line: the way from one to the other, and what is refused in one line."""

from __future__ import annotations

import pytest

from phaselead.control import load_learned
from phaselead.control.learning.look import End
from phaselead.control.learning.trials import _Course


@pytest.fixture(scope="module")  # of a path at the mode, where one shot leaves most
def table(run, stage_file, tmp_path_factory):
    folder = tmp_path_factory.mktemp("learned")
    words = ("learn", "sine:10um@200Hz", "--model", stage_file, "--trials", "3", "-o", folder / "learned.h5")
    outcome = run(*words, "--report", folder / "learned.html", "--json", "-")
    assert outcome.status == 0, outcome.err
    return folder / "learned.h5", outcome.json


def refused(outcome, *words):
    assert outcome.status == 2, outcome
    assert outcome.err.count("\n") == 1
    for word in words:
        assert word in outcome.err


def test_what_was_learned_is_played(run, stage_file, table):
    path, found = table
    assert found["best"]["rms_um"]["x"] < found["trials"][0]["rms_um"]["x"] / 2
    page = path.with_suffix(".html").read_text("utf-8")
    assert "Learned: sine:10um@200Hz" in page
    assert "<svg" in page
    assert load_learned(path).wave == "sine:10um@200Hz"
    track = ("track", "sine:10um@200Hz", "--model", stage_file, "--duration", "1", "--json", "-")
    plain, learned = run(*track, "--mode", "inverse+pid").json, run(*track, "--learned", path).json
    assert learned["mode"] == "inverse+pid"
    assert learned["true"]["max_pct"] < plain["true"]["max_pct"] / 1.5


def test_learning_can_come_first(run, stage_file):
    outcome = run("track", "sine:30um@50Hz", "--model", stage_file, "--learn", "2", "--json", "-")
    assert outcome.status == 0, outcome.err
    assert len(outcome.json["learned"]["trials"]) <= 3
    assert outcome.json["mode"] == "inverse+pid"


def test_measured_can_follow_instead(run, stage_file):
    """The stage is then ahead of its path by as much as its sensor is late."""
    track = ("track", "sine:30um@50Hz", "--model", stage_file, "--mode", "inverse+pid", "--json", "-")
    true, measured = run(*track).json, run(*track, "--track", "measured").json
    assert "sensor_lag_s" not in measured
    assert true["true"]["max_pct"] < measured["true"]["max_pct"] / 3


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("learn", "goto:30um"), ("driven once", "staircase:30um")),
        (("learn", "sine:30um@50Hz", "-o", "learned.csv"), ("must end in .h5",)),
        (("learn", "sine:30um@50Hz", "-o", "/no/such/learned.h5"), ("/no/such",)),
        (("learn", "sine:30um@50Hz", "--report", "/no/such/page.html"), ("/no/such",)),
        (("learn", "sine:60um@300Hz"), ("on the model this ends in",)),
        (("learn", "sine:30um@1e-9Hz"), ("one trial of this takes", "hours", "another frequency")),
        (("track", "sine:30um@50Hz", "--learned", "/no/such.h5"), ("cannot be read", "phaselead learn")),
        (("track", "goto:30um", "--learn", "3"), ("driven once",)),
        (("track", "sine:30um@50Hz", "--learn", "3", "--mode", "pid"), ("mode pid is not learned in",)),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(run, stage_file, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    refused(run(*words, "--model", stage_file), *said)
    assert list(tmp_path.iterdir()) == []


def test_without_a_model_the_way_to_one_is_said(run):
    refused(run("learn", "sine:30um@50Hz"), "--model STAGE.toml", "phaselead identify")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("sine:31um@50Hz",), "another path"),
        (("sine:10um@200Hz", "--mode", "inverse"), "for mode inverse+pid"),
        (("sine:10um@200Hz", "--gains", "paper"), "for the gains"),
        (("y=sine:10um@200Hz",), "is for x, the path for y"),
        (("sine:10um@200Hz", "--track", "measured"), "for the true position"),
    ],
)
def test_a_table_is_refused_for_what_it_is_not(run, stage_file, table, words, said):
    refused(run("track", *words, "--model", stage_file, "--learned", table[0]), said)


def test_a_table_needs_its_model(run, table):
    refused(run("track", "sine:10um@200Hz", "--learned", table[0]), "--model")


def test_learning_twice_over_is_refused(run, stage_file, table):
    words = ("track", "sine:10um@200Hz", "--model", stage_file, "--learned", table[0], "--learn", "2")
    refused(run(*words), "--learn", "--learned")


@pytest.fixture
def faulty(monkeypatch):
    """A device that latches a fault while it learns."""
    ended = End("stopped: fault adc_rail on axis x", None)
    monkeypatch.setattr(_Course, "_learn", lambda *_: ended)


@pytest.mark.usefixtures("faulty")
def test_a_fault_ends_it_with_the_status_of_one_and_what_was_learned(run, stage_file, tmp_path):
    """A script went on with a device that latches a fault."""
    words = ("learn", "sine:30um@50Hz", "--model", stage_file, "--trials", "2", "-o", tmp_path / "l.h5", "--json", "-")
    outcome = run(*words)
    assert outcome.status == 4
    assert outcome.json["in_fault"]
    assert load_learned(tmp_path / "l.h5").reason.startswith("stopped: fault")


@pytest.mark.usefixtures("faulty")
def test_nothing_is_tracked_after_a_fault_in_learning(run, stage_file):
    outcome = run("track", "sine:30um@50Hz", "--model", stage_file, "--learn", "2", "--json", "-")
    assert outcome.status == 4
    assert outcome.json["learned"]["in_fault"]
    assert "max_um" not in outcome.json
