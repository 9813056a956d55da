"""An identification as large as the user wants it, whose records outlive whatever ends it."""

from __future__ import annotations

import shutil
import signal
from collections import namedtuple
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import phaselead as pl
from phaselead import interrupt
from phaselead.errors import BadInput
from phaselead.identify import creep as creeping
from phaselead.identify import experiment as experiments
from phaselead.identify.plan import FEWEST, plan_of, plan_seconds
from phaselead.model import AxisModel, Limits, Stage, save_stage

SMALL = ("--levels", "1,2,3V", "--frequencies", "10,15,20Hz")
RECORDS = 3 * 3 + 2
LEVELS = st.lists(st.floats(0.1, 10), min_size=2, max_size=9, unique_by=lambda v: round(v, 1))
FREQUENCIES = st.lists(st.floats(0.5, 200), min_size=2, max_size=9, unique_by=lambda f: round(f, 1))


def ends_and_middle(values):
    return [min(values), sorted(values)[len(values) // 2], max(values)]


@given(LEVELS, FREQUENCIES, st.none() | st.floats(60, 400))
def test_a_plan_keeps_to_its_ends_its_time_and_holds_out_what_it_does_not_fit(levels, f_Hz, duration_s):
    shortest_s = plan_seconds(plan_of(levels_V=ends_and_middle(levels), f_Hz=ends_and_middle(f_Hz)))
    if duration_s is not None and duration_s < 3 * shortest_s:
        return
    plan = plan_of(levels_V=levels, f_Hz=f_Hz, duration_s=duration_s)
    grid = [(e.swing_V, e.f_Hz) for e in plan if not e.held_out]
    assert duration_s is None or plan_seconds(plan) <= duration_s
    swings, frequencies = ({point[i] for point in grid} for i in (0, 1))
    assert {min(levels), max(levels)} <= swings <= set(levels)
    assert {min(f_Hz), max(f_Hz)} <= frequencies <= set(f_Hz)
    assert min(len(swings), len(frequencies)) >= min(FEWEST, len(levels), len(f_Hz))
    for e in plan:
        if e.held_out:
            assert (e.swing_V, e.f_Hz) not in grid
            assert min(swings) < e.swing_V < max(swings)
            assert min(frequencies) < e.f_Hz < max(frequencies)


@given(st.floats(0.5, 150))
def test_u_max_is_the_largest_level(u_max):
    swings = [e.swing_V for e in plan_of(u_max_V=u_max)]
    assert max(swings) == pytest.approx(u_max)
    assert len(set(swings)) == 10


def test_without_wishes_the_grid_is_the_papers():
    assert plan_of() == experiments.plan_grid()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--levels", "1,xV"), "'xV' is no number"),
        (("--levels", "1,-2V"), "above 0"),
        (("--frequencies", "5V"), "no number with a unit of Hz"),
        (("--levels", "1,20V", "--u-max", "8V"), "above --u-max 8 V"),
        (("--duration", "5s"), "allow that"),
        (("--u-max", "30V"), "does not fit the limits"),
    ],
)
def test_a_grid_that_makes_no_sense_is_refused(run, tmp_path, words, told):
    outcome = run("identify", "-o", tmp_path / "s.toml", *words)
    assert outcome.status == 2
    assert told in outcome.err
    assert list(tmp_path.iterdir()) == []


def test_first_words_then_on_request_numbers(run, tmp_path):
    output = tmp_path / "s.toml"
    said = " ".join(run("identify", "-o", output, *SMALL).out.split())
    for word in ("um/V", "hysteresis", "% of the travel", " mode ", "lag", "the model leaves", "the sensor's noise"):
        assert word in said
    assert "play " not in said
    assert list(tmp_path.iterdir()) == [output]
    assert "play " in run("identify", "-o", output, "--overwrite", "--verbose", *SMALL).out


def test_a_stage_that_was_identified_is_not_written_over_unasked(run, tmp_path):
    (tmp_path / "s.toml").write_text("an afternoon")
    assert "exists already" in run("identify", "-o", tmp_path / "s.toml", *SMALL).err
    assert (tmp_path / "s.toml").read_text() == "an afternoon"


def failing(monkeypatch, error: BaseException, after: int) -> list[str]:
    """Ends the experiment with an error once so many records are there. The names of those measured."""
    measured: list[str] = []
    run_experiment = experiments.run_experiment

    def broken(device, experiment, *, alone):
        if len(measured) == after:
            raise error
        measured.append(experiment.name)
        return run_experiment(device, experiment, alone=alone)

    monkeypatch.setattr(experiments, "run_experiment", broken)
    return measured


@pytest.mark.parametrize(
    ("error", "status", "word"),
    [(KeyboardInterrupt(), 130, "the output is parked"), (OSError(28, "No space left on device"), 2, "No space left")],
)
def test_what_was_measured_is_kept_and_gone_on_with(run, tmp_path, monkeypatch, error, status, word):
    output = tmp_path / "s.toml"
    with monkeypatch.context() as patch:
        failing(patch, error, after=4)
        ended = run("identify", "-o", output, *SMALL)
    assert ended.status == status
    assert word in ended.err
    assert f"4 of {RECORDS} records are kept in {output}.records: go on with --resume" in ended.err
    assert not output.exists()
    again = run("identify", "-o", output, *SMALL)
    assert again.status == 2
    assert "--resume" in again.err
    measured = failing(monkeypatch, AssertionError(), after=RECORDS)
    assert run("identify", "-o", output, *SMALL, "--resume").status == 0
    assert len(measured) == RECORDS - 4
    assert list(tmp_path.iterdir()) == [output]


def test_an_interrupt_between_two_records_says_what_has_become_of_the_output(run, tmp_path, monkeypatch):
    """The signal was still waiting to be noticed, and ended the question whether the output is parked."""
    run_experiment = experiments.run_experiment

    def interrupted(device, experiment, *, alone):
        if list(tmp_path.glob("*/*.h5")):
            signal.raise_signal(signal.SIGINT)
        return run_experiment(device, experiment, alone=alone)

    monkeypatch.setattr(experiments, "run_experiment", interrupted)
    before = {number: signal.getsignal(number) for number in interrupt.ENDING}
    try:
        ended = run("identify", "-o", tmp_path / "s.toml", *SMALL)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        interrupt.clear()
    assert ended.status == 130
    assert "interrupted; the output is parked; 1 of" in ended.err


def test_records_found_again_are_those_measured(tmp_path):
    """To the bit: the stage file of a resumed session is the same as if the records had never left memory."""
    wishes = {"levels": [1, 2, 3], "frequencies": [10, 15, 20], "save": tmp_path / "kept"}
    with pl.connect() as dev:
        first = dev.identify(**wishes)
    with pl.connect() as dev:
        second = dev.identify(**wishes, resume=True)
    assert second.model.axes == first.model.axes
    assert second.model.provenance.data == first.model.provenance.data


def test_a_failing_fit_loses_no_record(run, tmp_path, monkeypatch):
    def fit(*_arguments, **_options):
        raise BadInput("the fit cannot be done")

    with monkeypatch.context() as patch:
        patch.setattr(experiments, "fit", fit)
        ended = run("identify", "-o", tmp_path / "s.toml", *SMALL)
    assert ended.status == 2
    assert f"{RECORDS} of {RECORDS} records are kept" in ended.err
    kept = sorted((tmp_path / "s.toml.records").iterdir())
    assert run("fit", *kept, "-o", tmp_path / "fitted.toml").status == 0


def test_space_is_looked_at_before_anything_is_driven(run, tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")(10**9, 10**9, 10**5)
    monkeypatch.setattr(shutil, "disk_usage", lambda _folder: usage)
    measured = failing(monkeypatch, AssertionError(), after=0)
    outcome = run("identify", "-o", tmp_path / "s.toml", *SMALL)
    assert outcome.status == 2
    assert "MB are free" in outcome.err
    assert measured == []


def test_records_of_another_calibration_are_not_mixed_in(run, tmp_path, monkeypatch, stage_file):
    output, folder = tmp_path / "s.toml", tmp_path / "kept"
    with monkeypatch.context() as patch:
        failing(patch, KeyboardInterrupt(), after=2)
        run("identify", "-o", output, *SMALL, "--save", folder)
    words = ("identify", "-o", output, *SMALL, "--save", folder)
    outcome = run(*words, "--resume", "--model", stage_file)
    assert outcome.status == 2
    assert "another model" in outcome.err
    assert run(*words, "--overwrite", "--model", stage_file).status == 0
    assert len(list(Path(folder).iterdir())) == RECORDS


def holds(monkeypatch, ended: BaseException | None = None) -> list[float]:
    """The highest voltage of each hold that is run; ``ended`` comes in the middle of the first."""
    highest_V: list[float] = []
    hold = creeping.hold

    def watched(device, axis, move):
        if ended is not None:
            raise ended
        record = hold(device, axis, move)
        highest_V.append(float(record.axes[axis].u_V.max()))
        return record

    monkeypatch.setattr(creeping, "hold", watched)
    return highest_V


def test_the_hold_for_creep_goes_no_further_than_the_sines(run, tmp_path, monkeypatch):
    """It went to 5 V, whatever --u-max."""
    highest_V = holds(monkeypatch)
    done: list[float] = []
    with pl.connect() as dev:
        found = dev.identify(levels=[1, 2, 3], frequencies=[10, 15, 20], creep=True, on_progress=done.append)
    assert highest_V == [pytest.approx(3, abs=0.001)]
    assert any(effect.name == "creep" for effect in found.model.axis("x").effects)
    assert done == sorted(done)
    assert done[-2] < 0.5 < done[-1] < 1


def test_a_hold_that_the_limits_do_not_bear_is_told_before_anything_moves(run, tmp_path, monkeypatch):
    stage = Stage(name="slow", axes={"x": AxisModel(limits=Limits(slew_V_per_s=20.0, ramp_V_per_s=20.0))})
    save_stage(tmp_path / "slow.toml", stage)
    measured = failing(monkeypatch, AssertionError(), after=0)
    words = ("--levels", "1,2,3V", "--frequencies", "0.5,1,2Hz", "--model", tmp_path / "slow.toml")
    outcome = run("identify", "-o", tmp_path / "s.toml", *words, "--creep")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "--creep moves to 3 V at up to 28.1 V/s" in outcome.err
    assert measured == []


def test_an_interrupt_in_the_hold_says_that_the_output_is_parked(run, tmp_path, monkeypatch):
    output = tmp_path / "s.toml"
    with monkeypatch.context() as patch:
        holds(patch, KeyboardInterrupt())
        ended = run("identify", "-o", output, *SMALL, "--creep")
    assert ended.status == 130
    assert "the output is parked" in ended.err
    assert f"{RECORDS} of {RECORDS} records are kept" in ended.err
    assert "--resume, without --creep" in ended.err


def test_creep_takes_the_records_of_one_session(run, tmp_path, monkeypatch):
    output = tmp_path / "s.toml"
    with monkeypatch.context() as patch:
        failing(patch, KeyboardInterrupt(), after=4)
        run("identify", "-o", output, *SMALL, "--creep")
    measured = failing(monkeypatch, AssertionError(), after=0)
    outcome = run("identify", "-o", output, *SMALL, "--creep", "--resume")
    assert outcome.status == 2
    assert "creep takes those of one" in outcome.err
    assert measured == []
