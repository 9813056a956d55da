"""Axes are named in one way, a voltage has its unit, and what is out of range names the command that tells."""

from __future__ import annotations

import json

import click
import pytest

import phaselead as pl
from phaselead.cli import main
from phaselead.control.tuning import course


def line(outcome, status: int = 2) -> str:
    assert (outcome.status, outcome.error, outcome.err.count("\n")) == (status, None, 1), outcome
    return outcome.err


@pytest.mark.parametrize(
    "words",
    [
        ("move", "x=20um"),
        ("track", "x=sine:20um@5Hz", "--mode", "pid"),
        ("track", "raster:10um"),
        ("log", "record", "--drive", "x=sine:2V@5Hz", "-o", "run.h5"),
    ],
)
def test_an_axis_is_not_named_twice(run, words):
    assert "leave the axis y out" in line(run(*words, "--axis", "y"))


@pytest.mark.parametrize("axes", ["x,y", "xy"])
def test_several_axes_do_the_same(run, axes):
    assert set(run("move", "20um", "--axis", axes, "--json", "-").json["axes"]) == {"x", "y"}
    tracked = run("track", "sine:10um@20Hz", "--axis", axes, "--mode", "pid", "--duration", "0.2", "--json", "-")
    assert set(tracked.json["axes"]) == {"x", "y"}
    limited = run("limits", "--axis", axes, "--x-max", "90um", "--json", "-").json
    assert (limited["x"]["x_max_um"], limited["y"]["x_max_um"]) == pytest.approx((90, 90), abs=0.01)
    assert limited["z"]["x_max_um"] is None


def test_limits_of_several_axes_are_set_all_or_none():
    with pl.connect() as dev:
        dev.set_limits("y", x_max_um=50)
        with pytest.raises(pl.BadInput, match="axis y"):
            dev.set_limits("x,y", x_min_um=60)
        assert not dev.limits()["x"]


def test_python_names_axes_alike():
    with pl.connect() as dev:
        run = dev.track("sine:10um@20Hz", axis="x,y", mode="pid", duration=0.2)
        assert sorted(run.recording.axes) == ["x", "y"]
        with pytest.raises(pl.BadInput, match="leave the axis y out"):
            dev.track("x=sine:10um@20Hz", axis="y", mode="pid")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("tune", "-o", "t.toml", "--level", "500"), "500 has no unit; write 500V or 500mV"),
        (("tune", "-o", "t.toml", "--middle", "4,5V"), "give one number"),
        (("identify", "-o", "i.toml", "--levels", "500,250"), "250 has no unit; write 250V or 250mV"),
        (("identify", "-o", "i.toml", "--u-max", "5"), "5 has no unit"),
        (("limits", "--axis", "x", "--u-max", "8"), "8 has no unit; write 8V or 8mV"),
        (("limits", "--axis", "x", "--slew", "500"), "500 has no unit; write 500V/s or 500V/ms or 500mV/s"),
        (("limits", "--axis", "x", "--x-max", "8V"), "'8V' is no number with a unit of um"),
        (("identify", "-o", "i.toml", "--u-max", "1e400V"), "'1e400V' is no finite number with a unit of V or mV"),
    ],
)
def test_a_voltage_says_its_unit(run, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    assert said in line(run(*words))


def test_a_move_beyond_a_hard_limit_names_the_command(run, tmp_path):
    port = ("--port", f"sim://xyz250?state={tmp_path / 'flash.bin'}")
    assert run("limits", "--axis", "x", "--x-max", "90um", *port).status == 0
    said = line(run("move", "x=95um", *port))
    assert "x: 95 um is beyond the hard limits of the device (..89.99" in said
    assert "`phaselead limits`" in said
    assert run("move", "x=85um", *port).status == 0


def test_a_move_out_of_range_is_no_waveform(run):
    said = line(run("move", "y=300um"))
    assert said == "phaselead: y: 300 um is outside what the sensor sees (-10..270 um); choose a place inside\n"


def test_limits_of_a_virtual_stage_are_said_to_be_lost(run, tmp_path):
    kept = f"sim://xyz250?state={tmp_path / 'flash.bin'}"
    words = ("limits", "--axis", "x", "--x-max", "90um")
    assert "state=flash.bin" in run(*words).out
    assert "state=flash.bin" not in run(*words, "--port", kept).out
    assert "state=flash.bin" not in run("limits").out


def test_tune_says_what_an_interrupt_left(run, tmp_path, monkeypatch):
    def interrupted(*_arguments, **_named):
        raise KeyboardInterrupt

    monkeypatch.setattr(course, "fit_plant", interrupted)
    said = line(run("tune", "-o", tmp_path / "tuned.toml"), 130)
    assert said == "phaselead: interrupted; the output is parked; nothing is kept: tune measures anew\n"
    assert not list(tmp_path.iterdir())


def test_a_warning_is_said_once(run, stage_file, tmp_path):
    """`track --learn` learns and tracks: both would warn of the same loop."""
    path = ("sine:20um@20Hz", "--model", stage_file, "--gains", "0,1.5,0", "--duration", "0.3")
    outcome = run("track", *path, "--learn", "1", "--json", "-")
    assert outcome.status == 0, outcome.err
    assert json.loads(outcome.out)["learned"]
    lines = [one for one in outcome.err.splitlines() if one.startswith("warning: ")]
    assert len(lines) == len(set(lines)) == 1


def timed():
    """Every option of a command that takes a time."""
    found = {}
    for name in main.list_commands(click.Context(main)):
        command = main.get_command(click.Context(main), name)
        both = {name: command, **{f"{name} {sub}": one for sub, one in getattr(command, "commands", {}).items()}}
        found |= {f"{of} {o.opts[0]}": o for of, one in both.items() for o in one.params if o.metavar == "S"}
    return found


def test_a_time_is_written_alike_in_every_command():
    options = timed()
    assert {"move --duration", "track --duration", "log record --duration", "identify --duration"} <= set(options)
    for name, option in options.items():
        for written, seconds in (("5", 5), ("5s", 5), ("0.5", 0.5), ("500ms", 0.5), ("2min", 120)):
            assert option.type.convert(written, option, None) == pytest.approx(seconds), name


def test_a_run_of_years_has_to_be_asked_for(run):
    said = line(run("track", "sine:20um@1e-9Hz", "--mode", "pid", "--port", "sim://xyz250"))
    assert "2.78e+06 hours" in said
    assert "--duration" in said


@pytest.mark.parametrize("written", ["99", "99%", "99 %"])
def test_a_share_may_be_written_with_its_sign(run, tmp_path, written):
    words = ("tune", "--port", "sim://xyz250", "-o", tmp_path / "x.toml", "--gain-share", written)
    assert "gains 99 % up and down: choose 0 to 50 %" in line(run(*words))


@pytest.mark.parametrize("written", ["5h", "soon", "", "5s,3s", "nan", "inf"])
def test_a_time_that_is_none_is_refused(run, written):
    assert "--duration" in line(run("move", "x=20um", "--duration", written))
