"""Gains from identification to the run: designed, shown, kept, checked."""

from __future__ import annotations

import pytest

from phaselead.control.gains import PAPER_GAINS, with_gains
from phaselead.model.stage_file import load_stage, save_stage


@pytest.fixture(scope="module", name="misfit")
def _misfit(stage_file, tmp_path_factory):
    """A stage file with gains of somebody's choice that its mode does not stand."""
    stage = load_stage(stage_file)
    x = stage.axis("x")
    mode = x.effects[0].model_copy(update={"params": {"f_Hz": 450.0, "zeta": 0.02}, "ci95": {}})
    path = tmp_path_factory.mktemp("misfit") / "stage.toml"
    changed = x.model_copy(update={"effects": (mode,), "gains": PAPER_GAINS})
    save_stage(path, stage.model_copy(update={"axes": {"x": changed}}))
    return path


def test_an_identified_stage_file_has_gains_made_for_it(stage_file):
    gains = load_stage(stage_file).axis("x").gains
    assert gains.origin.startswith("designed for peak sensitivity 2.0")
    assert with_gains(load_stage(stage_file)) == load_stage(stage_file)


@pytest.mark.parametrize("mode", ["pid", "ff+pid"])
def test_the_built_in_stage_is_driven_better_than_with_the_papers_gains(run, stage_file, mode):
    arguments = ("track", "sine:60um@5Hz", "--model", stage_file, "--mode", mode, "--json", "-")
    own, paper = run(*arguments), run(*arguments, "--gains", "paper")
    assert (own.status, paper.status) == (0, 0), own.err + paper.err
    assert own.json["max_um"] < 0.6 * paper.json["max_um"]


@pytest.mark.parametrize("command", [("upload",), ("track", "sine:60um@5Hz", "--mode", "pid", "--model")])
def test_a_loop_that_the_model_does_not_stand_is_refused_in_one_line(run, misfit, command):
    outcome = run(*command, misfit)
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "mode at 450 Hz: gain margin -" in outcome.err
    assert "--force" in outcome.err


def test_force_uploads_with_one_warning(run, misfit):
    outcome = run("upload", misfit, "--force")
    assert (outcome.status, outcome.err.count("\n")) == (0, 1)
    assert outcome.err.startswith("warning: x: the loop on the model is not stable")


def test_the_gains_that_the_refusal_names_work(run, misfit):
    arguments = ("track", "sine:60um@5Hz", "--mode", "pid", "--model", misfit, "--port", f"sim://{misfit}")
    named = run(*arguments).err.split("for the model (")[1].split(")")[0]
    assert run(*arguments, "--gains", named).status == 0
