"""An identification as large as the user wants it, whose records outlive whatever ends it."""

from __future__ import annotations

import re
import shutil
import signal
from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import phaselead as pl
from phaselead import interrupt
from phaselead.device.device import Device
from phaselead.errors import BadInput
from phaselead.identify import experiment as experiments
from phaselead.identify import held_creep
from phaselead.identify.fitting import FitReport
from phaselead.identify.plan import FEWEST, plan_of, plan_seconds
from phaselead.model import XU_LI_2010, AxisModel, Limits, Stage

CREEPING = ("--levels", "1,2,3V", "--frequencies", "10,15,20Hz")
SMALL = (*CREEPING, "--no-creep")
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


def test_a_model_of_one_sine_is_not_passed_off_as_one_of_the_stage(run, tmp_path):
    """Held-out records were off by 13 % beside a residual of 24 nm, without a word."""
    poor = run("identify", "--no-creep", "--levels", "2V", "--frequencies", "5Hz", "-o", tmp_path / "poor.toml")
    assert poor.status == 0
    assert "held-out records are off by" in poor.err
    assert "axis x: no gains" in poor.out
    assert "phaselead tune" in poor.out
    good = run("identify", "--no-creep", "--duration", "60s", "-o", tmp_path / "good.toml")
    assert (good.status, good.err) == (0, "")


def test_a_grid_that_goes_on_to_half_the_first_mode_gives_tables_up_to_there(run, tmp_path):
    """A mode of 200 Hz still rang from the begin of every sine above 40 Hz: all were left out of the table, and the
    command ended with all of it measured and nothing made of it."""
    grid = ("--levels", "0.5,1.5,2.5V", "--frequencies", "5,50,100Hz", "--no-creep")
    found = run("identify", "-o", tmp_path / "s.toml", *grid)
    assert (found.status, found.err) == (0, "")
    assert pl.load(tmp_path / "s.toml").axes["x"].table.f_Hz == (5, 100)
    for mode in ("ff", "ff+pid"):
        assert run("track", "sine:20um@60Hz", "--mode", mode, "--model", tmp_path / "s.toml").status == 0


def test_a_held_out_sine_beyond_the_tables_ends_no_identification():
    """Those at the edge of the grid may be left out of the fit."""
    stage, report = Stage(name="s", axes={"x": AxisModel(table=XU_LI_2010)}), FitReport({}, {})
    with pl.connect() as dev:
        inside, outside = (dev.record(f"sine:2V@{f_Hz}Hz", duration=1) for f_Hz in (10, 30))
    judged = experiments._by_table(stage, [inside, outside], report)
    assert [one.file for one in judged] == [inside.source]
    (said,) = report.messages
    assert said.startswith(outside.source)
    assert "outside the identified rectangle" in said


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


def test_nothing_to_go_on_from_is_said(run, tmp_path, monkeypatch):
    failing(monkeypatch, OSError(28, "No space left on device"), after=0)
    ended = run("identify", "-o", tmp_path / "s.toml", *SMALL, "--resume")
    assert "s.toml.records: holds no record to go on from; the experiment begins at its first" in ended.err


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
    assert f"all {RECORDS} records are kept" in ended.err
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


def holds(monkeypatch, ended: BaseException | None = None) -> list[tuple[float, float]]:
    """The highest voltage of each hold that is run, and its steepest rise; ``ended`` comes in the middle of the
    first."""
    held: list[tuple[float, float]] = []
    hold = held_creep.hold

    def watched(device, axis, move):
        if ended is not None:
            raise ended
        capture = hold(device, axis, move)
        u_V = held_creep.recording_of_hold(capture, axis).axes[axis].u_V
        held.append((float(u_V.max()), float((u_V[50:] - u_V[:-50]).max()) * 100))
        return capture

    monkeypatch.setattr(held_creep, "hold", watched)
    return held


def creep_of(model):
    return [effect for effect in model.axis("x").effects if effect.name == "creep"]


def test_the_hold_for_creep_goes_no_further_than_the_sines(monkeypatch):
    """It went to 5 V, whatever --u-max."""
    held = holds(monkeypatch)
    done: list[float] = []
    with pl.connect() as dev:
        found = dev.identify(levels=[1, 2, 3], frequencies=[10, 15, 20], on_progress=done.append)
    assert [highest_V for highest_V, _ in held] == [pytest.approx(3, abs=0.001)]
    assert creep_of(found.model)
    assert done == sorted(done)
    assert done[-2] < 0.5 < done[-1] < 1


def test_the_hold_keeps_to_the_slew_limit(monkeypatch):
    """A stage that bore the sines was refused, since the move into the hold was faster than they are."""
    held = holds(monkeypatch)
    slow = Stage(name="slow", axes={"x": AxisModel(limits=Limits(slew_V_per_s=23.0, ramp_V_per_s=23.0))})
    with pl.connect() as dev:
        found = dev.identify(model=slow, levels=[1, 2, 3], frequencies=[1.8, 2, 2.4])
    assert held == [(pytest.approx(3, abs=0.001), pytest.approx(23, rel=0.02))]
    assert np.sum(creep_of(found.model)[0].params["k"][1:]) == pytest.approx(0.014, rel=0.05)


def test_no_creep_leaves_the_hold_out(run, tmp_path, monkeypatch):
    held = holds(monkeypatch)
    outcome = run("identify", "-o", tmp_path / "s.toml", *SMALL, "--report", tmp_path / "s.html")
    assert outcome.status == 0
    assert (held, creep_of(pl.load(tmp_path / "s.toml"))) == ([], [])
    assert "No creep is known of this model" in (tmp_path / "s.html").read_text()


@pytest.mark.parametrize("words", [("--no-creep",), (), ("--axis", "x,y,z")])
def test_the_time_said_beforehand_is_the_time_it_takes(run, tmp_path, monkeypatch, words):
    ticks = []
    exit_ = Device.__exit__

    def counted(device, *error):
        ticks.append(device.status().tick)
        return exit_(device, *error)

    monkeypatch.setattr(Device, "__exit__", counted)
    outcome = run("identify", "-o", tmp_path / "s.toml", *CREEPING, *words)
    minutes, seconds = re.search(r"take (?:(\d+) min )?(\d+) s of the device's time", outcome.out).groups()
    assert ticks[0] / 5000 == pytest.approx(60 * int(minutes or 0) + int(seconds), rel=0.02, abs=1.5)


def test_a_duration_leaves_the_sines_their_time(run, tmp_path, monkeypatch):
    """They would be thinned until no mode is seen; asked for, creep has its place."""
    held = holds(monkeypatch)
    outcome = run("identify", "-o", tmp_path / "s.toml", *CREEPING, "--duration", "60s")
    assert outcome.status == 0
    assert "60 s leave no time for creep" in outcome.err
    assert held == []
    outcome = run("identify", "-o", tmp_path / "t.toml", *CREEPING, "--duration", "60s", "--creep")
    assert outcome.status == 2
    assert "--no-creep" in outcome.err
    assert run("identify", "-o", tmp_path / "t.toml", *CREEPING, "--duration", "100s").status == 0
    assert len(held) == 1


def test_what_is_kept_is_counted_on_disk(run, tmp_path, monkeypatch):
    """It counted what this session had looked at: fewer while it resumed, none at its beginning."""
    output = tmp_path / "s.toml"
    with monkeypatch.context() as patch:
        failing(patch, KeyboardInterrupt(), after=4)
        run("identify", "-o", output, *SMALL)
    monkeypatch.setattr(Device, "read_model", lambda device: (_ for _ in ()).throw(KeyboardInterrupt()))
    ended = run("identify", "-o", output, *SMALL, "--resume")
    assert f"4 of {RECORDS} records are kept in {output}.records: go on with --resume" in ended.err


def test_records_that_were_refused_are_not_to_be_resumed(run, tmp_path, monkeypatch):
    """--resume was named, and read the same clipped records again, for ever."""

    def refused(*_arguments, **_named):
        raise BadInput("x-3V-10Hz: the position of axis x is clipped at 80 um")

    output = tmp_path / "s.toml"
    monkeypatch.setattr(experiments, "fit", refused)
    ended = run("identify", "-o", output, *SMALL)
    assert "go on with --resume" not in ended.err
    assert f"all {RECORDS} records are kept in {output}.records" in ended.err
    assert "measured again once its file is deleted, all with --overwrite" in ended.err
    assert (tmp_path / "s.toml.records" / "x-3V-10Hz.h5").exists()


def test_an_interrupt_in_the_hold_says_how_to_go_on(run, tmp_path, monkeypatch):
    output, kept = tmp_path / "s.toml", tmp_path / "kept"
    with monkeypatch.context() as patch:
        holds(patch, KeyboardInterrupt())
        ended = run("identify", "-o", output, *CREEPING, "--save", kept)
    assert ended.status == 130
    assert "the output is parked" in ended.err
    assert f"{RECORDS} of {RECORDS + 1} records are kept in {kept}: go on with --resume" in ended.err
    measured = failing(monkeypatch, AssertionError(), after=0)
    outcome = run("identify", "-o", output, *CREEPING, "--save", kept, "--resume")
    assert (outcome.status, measured) == (0, [])
    assert "1 hold for creep to be measured" in outcome.out
    assert (kept / "creep" / "x-hold.h5").exists()
    assert len(list(kept.glob("*.h5"))) == RECORDS


def test_what_crept_is_not_carried_from_one_session_into_the_next(tmp_path, monkeypatch):
    """It was refused: what goes on from one record into the next was not known of records of two sessions."""
    wishes = {"levels": [1, 2, 3], "frequencies": [10, 15, 20]}
    with pl.connect() as dev:
        whole = dev.identify(**wishes)
    with monkeypatch.context() as patch, pl.connect() as dev:
        failing(patch, KeyboardInterrupt(), after=4)
        with pytest.raises(KeyboardInterrupt):
            dev.identify(**wishes, save=tmp_path)
    began: list[list[float | None]] = []
    without_creep = held_creep.without_creep

    def watched(records, axis, k, rested_s):
        began.append(list(rested_s))
        return without_creep(records, axis, k, rested_s)

    monkeypatch.setattr(held_creep, "without_creep", watched)
    with pl.connect() as dev:
        first = dev.device.status().tick
        resumed = dev.identify(**wishes, save=tmp_path, resume=True)
        assert dev.device.status().tick - first > 5000 * (40 + 52 + 7 * 3)
    ((start, *rested_s),) = began
    assert (start, rested_s[3]) == (None, None)
    assert [pause_s for pause_s in rested_s if pause_s is not None] == pytest.approx([3.2] * 9, abs=0.2)
    ours, theirs = resumed.model.axis("x"), whole.model.axis("x")
    np.testing.assert_allclose(creep_of(resumed.model)[0].params["k"], creep_of(whole.model)[0].params["k"], rtol=0.05)
    assert ours.time.residual_um_rms == pytest.approx(theirs.time.residual_um_rms, rel=0.02)
