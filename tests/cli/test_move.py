"""move, hold and where: from the command line, and from one command to the next on a stage that stays."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import warnings

import pytest

from phaselead.cli.common import HELD
from phaselead.control import Controller
from phaselead.control.moving import Mover
from phaselead.errors import DeviceRefused
from phaselead.sim import built_in


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "stage.toml"
    built_in("xyz250").save(path)
    return path


def test_a_move_says_when_it_will_have_settled_and_when_it_had(run, model):
    outcome = run("move", "x=50um", "--model", model)
    assert outcome.status == 0, outcome.err
    assert "to 50.000 um in" in outcome.out
    assert "on the model settled after" in outcome.out.splitlines()[0]
    figures = run("move", "50um", "--axis", "y", "--model", model, "--json", "-").json["axes"]["y"]
    assert abs(figures["x_um"] - 50) < 0.1
    assert figures["settled_s"] == pytest.approx(figures["predicted_s"], abs=0.01)


def test_on_target_is_what_stays_within_the_window(run, model):
    """The rehearsal and the device count by the same."""
    settled = {}
    for um in (0.01, 0.1, 20.0):
        (figures,) = run("move", "x=50um", "--window", str(um), "--model", model, "--json", "-").json["axes"].values()
        assert figures["window_um"] == um
        settled[um] = [figures[name] for name in ("predicted_s", "settled_s")]
    assert settled[0.01] == [None, None]  # less than the noise: never within a second
    assert all(wide <= narrow for wide, narrow in zip(settled[20.0], settled[0.1], strict=True))
    assert settled[20.0][1] < settled[0.1][1]


def test_a_speed_has_its_unit_or_none(run, model):
    lasts_s = [
        run("move", "x=50um", "--speed", text, "--model", model, "--json", "-").json["axes"]["x"]["duration_s"]
        for text in ("500", "500um/s", "0.5mm/s")
    ]
    assert lasts_s == pytest.approx([lasts_s[0]] * 3)
    assert lasts_s[0] == pytest.approx(1.875 * 50 / 500, rel=0.01)


def test_a_speed_and_a_duration_must_agree(run, model):
    """Both were taken, and the speed won: 1.1 s where 1 s was asked for."""
    words = ("move", "x=60um", "--speed", "100", "--model", model, "--json", "-")
    refused = run(*words, "--duration", "1")
    assert refused.status == 2
    assert "at its highest takes 1.1" in refused.err
    assert "not 1 s: give duration or speed" in refused.err
    alone = run(*words).json["axes"]["x"]["duration_s"]
    assert run(*words, "--duration", f"{alone:.3f}").status == 0


@pytest.mark.parametrize("words", [("--duration", "1e9"), ("--speed", "0.0001")])
def test_a_move_of_years_is_refused_at_once(run, model, words):
    """It was tried on the model for hours, without a word."""
    refused = run("move", "x=60um", *words, "--model", model)
    assert refused.status == 2
    assert "give it at most 3600 s, or a higher speed" in refused.err


def test_without_a_model_it_moves_slowly_under_feedback(run):
    (figures,) = run("move", "x=20um", "--json", "-").json["axes"].values()
    assert figures["duration_s"] == pytest.approx(0.0375, abs=0.001)
    assert figures["predicted_s"] is None


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("x=300um",), "outside what the sensor sees"),
        (("x=50um", "--duration", "0.0005"), "the shortest is"),
        (("x=50um", "--speed", "0"), "above 0"),
        (("x=50um", "--speed", "100um"), "'100um' is no number with a unit of um/s or mm/s"),
        (("x=50um", "--window", "0"), "a window of 0 um"),
        (("x=50um", "--window", "nan"), "'nan' is no number"),
        (("w=50um",), "no axis w"),
        (("x=5V",), "takes micrometres"),
        (("x=5",), "'5' has no unit: use um; write it"),
        (("x=1um", "--mode", "pid", "--gains", "lots"), "gains 'lots': write paper"),
        (("x=50um", "--mode", "inverse"), "needs a model"),
        (("x=1um", "--mode", "pid", "--gains", "1,2"), "KP,KI,KD"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(run, words, said):
    outcome = run("move", *words)
    assert (outcome.status, outcome.out, outcome.err.count("\n")) == (2, "", 1)
    assert said in outcome.err


def test_quiet_says_nothing_of_the_plan(run, model):
    outcome = run("--quiet", "move", "x=50um", "--model", model)
    assert (outcome.status, outcome.out, outcome.err) == (0, "", "")


def test_warnings_come_before_the_motion(run, model, monkeypatch):
    """They came after it, and not at all when it failed."""

    def refused(*_given, **_how):
        raise DeviceRefused("not now")

    monkeypatch.setattr(Mover, "choose", lambda *_given, **_how: ["the loop will swing"])
    monkeypatch.setattr(Mover, "plan", refused)
    outcome = run("move", "x=50um", "--model", model)
    assert outcome.status == 4
    assert outcome.err.startswith("warning: the loop will swing\nphaselead: not now")


def test_where_and_hold_have_json(run):
    where = run("where", "--json", "-").json
    assert (where["state"], where["axes"]["x"]["held"]) == ("parked", False)
    assert [where["axes"]["x"][name] for name in ("target_um", "reference_um")] == [None, None]  # was 0.0
    hold = run("hold", "--json", "-").json
    assert (hold["state"], hold["axes"]["x"]["held"]) == ("running", True)
    assert hold["axes"]["x"]["target_um"] == pytest.approx(0, abs=0.2)


@pytest.fixture
def phaselead(tmp_path):
    """One program after another on a stage that stays, on a pseudo-terminal in real time: status, output and errors."""
    link = tmp_path / "stage"
    env = os.environ | {"XDG_STATE_HOME": str(tmp_path / "state")}

    def command(*words):
        command = [sys.executable, "-m", "phaselead", *words, "--port", str(link)]
        done = subprocess.run(command, capture_output=True, text=True, env=env, timeout=60)
        return done.returncode, done.stdout, done.stderr

    serve = [sys.executable, "-m", "phaselead", "sim", "--pty", "--link", str(link)]
    served = subprocess.Popen(serve, stdout=subprocess.PIPE, env=env)
    try:
        served.stdout.readline()
        yield command
    finally:
        served.terminate()
        served.wait()
        served.stdout.close()


def test_the_stage_stays_held_from_one_command_to_the_next(phaselead, model):
    """What is refused moves nothing."""
    assert phaselead("move", "x=40um", "--model", str(model), "--duration", "0.05")[0] == 0
    status, out, _ = phaselead("where", "--json", "-")
    here = json.loads(out)
    assert (status, here["state"], here["axes"]["x"]["on_target"]) == (0, "running", True)
    for refused in (("x=60um", "--duration", "0.001"), ("x=400um",), ("x=400um", "--model", str(model))):
        assert phaselead("move", *refused)[0] == 2
    still = json.loads(phaselead("where", "--json", "-")[1])
    assert (still["state"], still["axes"]["x"]["target_um"]) == ("running", 40)
    figures = json.loads(phaselead("move", "x=+5um", "--json", "-")[1])["axes"]["x"]
    assert figures["to_um"] == 45
    status, _, err = phaselead("info")
    assert status != 0
    assert "phaselead park" in err
    assert phaselead("park")[0] == 0
    assert json.loads(phaselead("where", "--json", "-")[1])["state"] == "parked"
    path = ("sine:20um+30um@5Hz", "--mode", "inverse+pid", "--model", str(model), "--duration", "0.4", "--hold")
    status, out, _ = phaselead("track", *path)
    assert (status, out.splitlines()[-1]) == (0, HELD)
    figures = json.loads(phaselead("move", "x=+5um", "--json", "-")[1])["axes"]["x"]
    assert figures["to_um"] == pytest.approx(figures["from_um"] + 5)
    assert phaselead("park")[0] == 0


def test_a_path_goes_on_from_where_a_command_left_the_stage_held(phaselead, model, tmp_path):
    """What is refused leaves it there; the run can be replayed; in the end it is parked."""

    def where():
        found = json.loads(phaselead("where", "--json", "-")[1])
        return found["state"], found["axes"]["x"]["target_um"]

    run = str(tmp_path / "run.h5")
    assert phaselead("move", "x=40um", "--model", str(model))[0] == 0
    for words, said in (
        (("sine:20um@5Hz", "--mode", "pid"), "held in mode inverse+pid; park"),
        (("sine:20um@5Hz", "--learn", "1"), "begins at rest; `phaselead park`"),
    ):
        status, _, err = phaselead("track", *words)
        assert (status in (2, 4), err.splitlines()[-1].startswith("phaselead: ")) == (True, True)
        assert said in err
        assert where() == ("running", 40)
    path = ("triangle:20um+30um@5Hz", "--duration", "0.4", "--hold", "--model", str(model), "-o", run)
    status, out, err = phaselead("track", *path)
    assert (status, out.splitlines()[-1]) == (0, HELD), err
    assert where()[0] == "running"
    status, out, err = phaselead("track", "sine:20um+10um@5Hz", "--duration", "0.4", "--json", "-")
    assert status == 0, err
    assert json.loads(out)["mode"] == "inverse+pid"
    assert where()[0] == "parked"
    command = [sys.executable, "-m", "phaselead", "replay", run, "--json", "-"]
    assert json.loads(subprocess.run(command, capture_output=True, text=True).stdout)["equal"]


def test_an_interrupt_on_the_way_says_that_it_is_parked(run, monkeypatch):
    def interrupted(*_given, **_how):
        raise KeyboardInterrupt

    monkeypatch.setattr(Mover, "move", interrupted)
    ended = run("move", "x=50um")
    assert (ended.status, ended.err) == (130, "phaselead: interrupted; the output is parked\n")


def test_what_a_command_is_warned_of_is_a_line_of_its_own(run, monkeypatch):
    """`hold` printed a path of ours and a line of code."""
    hold = Controller.hold

    def warned(self):
        warnings.warn("gains are low", stacklevel=2)
        return hold(self)

    monkeypatch.setattr(Controller, "hold", warned)
    assert run("hold").err == "warning: gains are low\n"
