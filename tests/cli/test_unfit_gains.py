"""A stage with a mode that its model lacks, driven with the gains designed for that model: what the user is told."""

import numpy as np
import pytest

import phaselead as pl
from phaselead.control import describe_unseen, with_gains
from phaselead.control.moved import AxisMoved, Moved
from phaselead.control.run_away import run_away, swinging_Hz
from phaselead.device import explain_fault
from phaselead.model import load_stage
from phaselead.record import AxisRecord, Recording

STEP_s = 2e-4
T_s = np.arange(3000) * STEP_s


@pytest.fixture(scope="module", name="identified")
def _identified(run, tmp_path_factory):
    """x500 as it is identified, and what was said: its mode at 310 Hz does not show."""
    path = tmp_path_factory.mktemp("x500") / "x500.toml"
    outcome = run("identify", "-o", path, "--port", "sim://x500", "--no-creep")
    assert outcome.status == 0, outcome.err
    return path, outcome


@pytest.fixture(scope="module", name="slow_stage")
def _slow_stage(identified):
    """The same as if its first mode carried all of the motion, at a damping of 0.015 for 0.012: gains designed for that
    excite the mode that does not show."""
    stage = load_stage(str(identified[0]))
    x = stage.axis("x")
    (mode,) = [effect for effect in x.effects if effect.name == "resonance"]
    whole = mode.model_copy(update={"params": {**mode.params, "c": (1.0,), "zeta": (0.015,)}})
    effects = tuple(whole if effect is mode else effect for effect in x.effects)
    path = identified[0].with_name("whole.toml")
    with_gains(stage.model_copy(update={"axes": {"x": x.model_copy(update={"effects": effects})}})).save(path)
    return path


def test_identify_says_up_to_where_it_drives_and_who_measures_the_rest(identified):
    said = " ".join(identified[1].out.split())
    assert "axis x: driven up to 20 Hz, where faster modes hardly show" in said
    assert "`phaselead tune` measures them" in said


def test_gains_of_somebodys_choice_are_not_spoken_of(slow_stage):
    stage = load_stage(str(slow_stage))
    x = stage.axis("x")
    assert len(describe_unseen(stage, 20.0)) == 1
    own = x.model_copy(update={"gains": x.gains.model_copy(update={"origin": None})})
    for axis in (own, x.model_copy(update={"gains": None})):
        assert describe_unseen(stage.model_copy(update={"axes": {"x": axis}}), 20.0) == []


def test_a_run_with_gains_that_do_not_fit_names_tune(run, slow_stage):
    """It once ended in adc_rail with no word on the loop."""
    wave = ("track", "sine:40um@10Hz", "--mode", "inverse+pid", "--port", "sim://x500")
    unasked = run(*wave, "--model", slow_stage)
    assert unasked.status == 4
    assert "the loop of x is unstable: its error came to swing at about 3" in unasked.err
    assert "no --gains were given" in unasked.err
    assert "`phaselead tune`" in unasked.err
    asked = run(*wave, "--model", slow_stage, "--gains", written_gains(slow_stage))
    assert "the loop of x is unstable" in asked.err
    assert "lower the gains" in asked.err


@pytest.mark.parametrize("command", [("track", "sine:20um@5Hz", "--mode", "pid"), ("move", "x=20um")])
def test_the_papers_gains_are_warned_of_where_nobody_asked_for_them(run, tmp_path, command):
    """Of an unknown stage, whose mode may be anywhere: it ran away without a word before."""
    pl.load("sim://xyz250").save(tmp_path / "any.toml")
    port = ("--port", f"sim://{tmp_path / 'any.toml'}")
    assert "nothing is known of this stage" in run(*command, *port).err
    for known in ((*port, "--gains", "paper"), (*port, "--model", tmp_path / "any.toml"), ()):
        assert "nothing is known" not in run(*command, *known).err


def test_a_path_that_is_refused_on_its_model_is_one_line(run, tmp_path):
    """What the device leaves of it was warned of first."""
    pl.load("sim://xyz250").save(tmp_path / "s.toml")
    how = ("--model", tmp_path / "s.toml", "--mode", "inverse+pid", "--duration", "0.5")
    refused = run("track", "chirp:60um@1..150Hz", *how)
    assert refused.status == 2
    assert refused.err.startswith("phaselead: x: it goes at")
    assert refused.err.count("\n") == 1
    driven = run("track", "chirp:5um@1..50Hz", *how)
    assert driven.status == 0
    assert driven.err.startswith("warning: x: the device plays 1024 points a period")


def written_gains(path):
    g = load_stage(str(path)).axis("x").gains
    return f"{g.kp_V_per_um!r},{g.ki_V_per_um_s!r},{g.kd_V_s_per_um!r}"


def test_a_move_that_runs_away_names_tune(run, slow_stage):
    outcome = run("move", "x=50um", "--model", slow_stage, "--port", "sim://x500", "--park")
    assert outcome.status == 4
    assert "`phaselead tune`" in outcome.err
    assert "the loop is unstable" in outcome.err


@pytest.mark.parametrize(
    ("predicted_s", "settled_s", "waited", "told"),
    [(0.05, None, True, True), (0.05, 0.06, True, False), (None, None, True, False), (0.05, None, False, False)],
)
def test_a_move_that_does_not_settle_as_on_its_model_names_tune(predicted_s, settled_s, waited, told):
    moved = Moved({"x": AxisMoved(0.0, 50.0, 0.008, settled_s, predicted_s, 49.5, 0.1)}, waited)
    assert ("`phaselead tune`" in str(moved)) == told


@pytest.mark.parametrize("fault", ["adc_rail", "oscillation"])
def test_the_manual_names_tune_for_gains_that_nobody_chose(fault):
    assert "phaselead tune" in explain_fault(fault).text


def recorded(error_um):
    r_um = 20 * np.sin(2 * np.pi * 10 * T_s)
    axis = AxisRecord(u_V=None, x_um=r_um - error_um, r_um=r_um)
    return Recording(t_s=T_s, axes={"x": axis})


def held_back():
    """Swings at 310 Hz that grow in bursts, as the slew limit makes them."""
    size = np.where(T_s < 0.3, 0.05, 10 + 5 * np.sin(2 * np.pi * 17 * T_s))
    return size * np.sin(2 * np.pi * 310 * T_s) + np.random.default_rng(1).normal(0, 0.02, len(T_s))


def test_a_loop_held_back_by_the_slew_limit_has_run_away():
    assert swinging_Hz(held_back(), np.zeros(len(T_s)), STEP_s) == pytest.approx(310, abs=10)
    assert "at about 310 Hz" in run_away(recorded(held_back()), len(T_s))


@pytest.mark.parametrize(
    "error_um",
    [
        np.where(T_s < 0.55, 0.0, 60.0),
        np.where(T_s < 0.55, 0.02, 60.0) * np.linspace(0, 1, len(T_s)),
        10 * np.sin(2 * np.pi * 310 * T_s),
        np.r_[np.zeros(2500), np.linspace(0, 60, 500)],
        np.zeros(len(T_s)),
        np.zeros(300),
    ],
    ids=["unplugged", "drifts off", "rings from the first", "end of the range", "nothing", "short"],
)
def test_what_does_not_come_to_swing_has_not_run_away(error_um):
    noise = np.random.default_rng(2).normal(0, 0.02, len(error_um)) if np.any(error_um) else 0.0
    assert swinging_Hz(error_um + noise, np.zeros(len(error_um)), STEP_s) is None


def test_a_path_that_comes_to_swing_is_no_loop_that_ran_away():
    path_um = np.where(T_s < 0.3, 0.0, 20 * np.sin(2 * np.pi * 310 * T_s))
    assert swinging_Hz(2 * path_um, path_um, STEP_s) is None
