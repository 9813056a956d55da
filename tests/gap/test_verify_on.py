"""Tracking with the new model: both models on one device, and what the report and the JSON say of it."""

import json
from dataclasses import replace

import pytest
from click.testing import CliRunner

from phaselead.cli import gap_run, main
from phaselead.errors import BadInput
from phaselead.gap.findings import GapSize
from phaselead.gap.result import GapResult
from phaselead.gap.verify_on import check_port, verify_on
from phaselead.model.axis import AdoptedEffect, AxisModel, Gains, TimeView
from phaselead.model.stage_file import Stage, save_stage

STAIRCASE_s = 0.00012
"""What a held, latched output is late of the straight line between ticks."""
SENSOR = ("sensor_lowpass", {"tau_s": 8e-5})
HYSTERESIS = ("hysteresis", {"width": 0.12})
CREEP = ("creep", {"gamma": 0.03})
COUPLING = ("cross_coupling", {"from_y": 0.05})


def axis(*effects, delay_s=STAIRCASE_s, gain=18.0, gains=None):
    view = TimeView(gain_um_per_V=gain, u_range_V=(-2.0, 10.0), rate_Hz=5000.0, delay_s=delay_s)
    adopted = tuple(AdoptedEffect(name=name, params=params) for name, params in (SENSOR, *effects))
    return AxisModel(time=view, effects=adopted, gains=gains)


def stage(x, y=None):
    return Stage(name="s", axes={"x": x} if y is None else {"x": x, "y": y})


@pytest.fixture
def port(tmp_path):
    """A stage with hysteresis and creep on x."""
    save_stage(tmp_path / "truth.toml", stage(axis(HYSTERESIS, CREEP, delay_s=0.0)))
    return f"sim://{tmp_path / 'truth.toml'}"


def test_what_was_named_makes_tracking_better(port):
    found = verify_on(port, stage(axis()), stage(axis(HYSTERESIS, CREEP)))
    assert found.messages == ()
    assert [row.path.split(",")[0] for row in found.tracked] == ["sine", "triangle", "move and hold"]
    for row in found.tracked:
        assert row.mode == "inverse"
        assert row.after.rms_um < 0.1 * row.before.rms_um, row.path
        assert len(row.t_s) == len(row.r_um) == len(row.before_error_um) == len(row.after_error_um)


def test_with_gains_of_its_own_feedback_runs_too(port):
    gains = Gains(kp_V_per_um=0.0, ki_V_per_um_s=2.0, kd_V_s_per_um=0.0)
    found = verify_on(port, stage(axis(gains=gains)), stage(axis(HYSTERESIS, gains=gains)))
    assert [row.mode for row in found.tracked] == ["inverse", "inverse", "inverse+pid", "inverse+pid"]


def test_neighbours_move_where_they_are_felt(tmp_path):
    save_stage(tmp_path / "truth.toml", stage(axis(COUPLING, delay_s=0.0), axis(delay_s=0.0)))
    found = verify_on(f"sim://{tmp_path / 'truth.toml'}", stage(axis(), axis()), stage(axis(COUPLING), axis()))
    x = [row for row in found.tracked if row.axis == "x"]
    assert {row.axis for row in found.tracked} == {"x", "y"}
    assert all(row.after.rms_um < 0.2 * row.before.rms_um for row in x)


def test_what_cannot_be_run_is_said(port):
    same = verify_on(port, stage(axis()), stage(axis()))
    assert (same.tracked, same.messages) == ((), ("the model did not change; there is nothing to verify",))
    flat = verify_on(port, stage(axis(gain=0.0)), stage(axis(HYSTERESIS)))
    assert flat.tracked == ()
    assert "axis x was not driven: the model before has no inverse: its time view falls" in flat.messages[0]
    gone = verify_on("sim://no/such/stage.toml", stage(axis()), stage(axis(HYSTERESIS)))
    assert gone.tracked == ()
    assert gone.messages[0].startswith("on sim://no/such/stage.toml it went no further: ")
    with pytest.raises(BadInput):
        check_port("sim://no/such/stage.toml")


@pytest.fixture
def adopted(monkeypatch, tmp_path):
    """`phaselead gap` with a search that has named the hysteresis; the model's file."""
    after = stage(axis(HYSTERESIS))
    result = GapResult(after, ("named",), (), (), (), (), (), GapSize(2.0, 0.1, 0.05, "um", "noise"), None, ("0" * 64,))
    monkeypatch.setattr(gap_run, "run_gap", lambda *_, **__: replace(result))
    monkeypatch.setattr(gap_run, "read_recordings", lambda *_: [])
    save_stage(tmp_path / "base.toml", stage(axis()))
    return tmp_path


def gap(folder, *more):
    names = ("next.toml", "gap.html", "gap.json")
    outputs = [str(folder / name) for name in names]
    arguments = [
        "gap",
        "--model",
        str(folder / "base.toml"),
        "--train",
        "a.csv",
        "--holdout",
        "b.csv",
        "-o",
        outputs[0],
    ]
    return CliRunner().invoke(main, [*arguments, "--report", outputs[1], "--json", outputs[2], *more])


def test_the_command_reports_both(adopted, port):
    done = gap(adopted, "--verify-on", port)
    assert done.exit_code == 0, done.output
    content = json.loads((adopted / "gap.json").read_text())
    assert set(content["tracking"]["runs"][0]) == {"axis", "path", "mode", "before", "after"}
    page = (adopted / "gap.html").read_text()
    assert "Is a path followed better with the next model?" in page
    assert page.count("with the model before (orange)") == 2
    assert "tracking on" in done.output


def test_without_it_nothing_changes(adopted):
    assert gap(adopted).exit_code == 0
    assert "tracking" not in json.loads((adopted / "gap.json").read_text())
    assert "Is a path followed better with the next model?" not in (adopted / "gap.html").read_text()


def test_a_port_that_is_none_is_refused_before_the_search(adopted):
    done = gap(adopted, "--verify-on", "sim://no/such/stage.toml")
    assert isinstance(done.exception, BadInput) or done.exit_code == 2
    assert not (adopted / "next.toml").exists()
