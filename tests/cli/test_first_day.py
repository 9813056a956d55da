"""What a person meets on the first day: readable answers, nothing lost or driven unasked, advice that works."""

from __future__ import annotations

import json
import re

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

import phaselead as pl
from phaselead.cli import main
from phaselead.control import load_learned
from phaselead.control.run_away import growing_Hz
from phaselead.device import explain_fault, fault_names
from phaselead.device.loop_test import LoopResult, SelfTest

UNSTABLE = ("sine:60um@5Hz", "--mode", "pid", "--gains", "0.1,8.62,0")


def answered(text: str, *words: object):
    """`phaselead WORDS` with somebody at the keyboard who types ``text``."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("phaselead.cli.common.asked_of_a_person", lambda: True)
        return CliRunner().invoke(main, list(map(str, words)), input=text)


def test_status_is_in_um_and_volts(run):
    said = run("status").out
    assert "position (\N{MICRO SIGN}m)" in said
    assert "output (V)" in said
    assert "parked, no fault, no model" in said
    assert "2337" not in said
    at = run("status", "--json", "-").json["axes"]["x"]
    assert at["u_V"] == 0
    assert abs(at["x_um"]) < 1


@pytest.mark.parametrize("mode", ["ff", "inverse", "inverse+pid"])
def test_a_persisted_model_drives_without_its_file(run, stage_file, tmp_path, mode):
    port = f"sim://xyz250?state={tmp_path / 'flash.bin'}"
    assert run("upload", stage_file, "--persist", "--port", port).status == 0
    words = ("track", "sine:60um@5Hz", "--mode", mode, "--port", port, "--json", "-")
    outcome = run(*words)
    assert outcome.status == 0, outcome.err
    assert outcome.json["max_pct"] < 5
    assert ("does not tell the modes" in outcome.err) == mode.endswith("pid")
    assert "30 Hz lies outside" in run("track", "sine:60um@30Hz", "--mode", "ff", "--port", port).err


def test_a_persisted_model_is_enough_to_learn_with(run, stage_file, tmp_path):
    """learn, and track --learned, asked for --model."""
    port, table = f"sim://xyz250?state={tmp_path / 'flash.bin'}", tmp_path / "learned.h5"
    assert run("upload", stage_file, "--persist", "--port", port).status == 0
    outcome = run("learn", "sine:10um@200Hz", "--trials", 3, "-o", table, "--port", port, "--json", "-")
    assert outcome.status == 0, outcome.err
    assert "does not tell the modes" in outcome.err
    first, *_, last = [trial["rms_um"]["x"] for trial in outcome.json["trials"] if trial["kept"]]
    assert last < first / 2
    assert load_learned(table).stage_sha256 == pl.load(stage_file).sha256
    played = run("track", "sine:10um@200Hz", "--learned", table, "--port", port, "--json", "-")
    assert played.status == 0, played.err
    assert played.json["rms_um"] < first / 2
    other = run("track", "sine:10um@200Hz", "--learned", table)
    assert other.status == 2
    assert "needs the model it was learned with" in other.err


@pytest.mark.parametrize("command", ["track", "learn"])
def test_without_a_model_anywhere_the_way_to_one_is_said(run, command):
    outcome = run(command, "sine:60um@5Hz", "--mode", "inverse")
    assert outcome.status == 2
    for word in ("the device holds none", "--model", "identify", "upload --persist"):
        assert word in outcome.err


@pytest.mark.parametrize(
    "words",
    [
        ("track", "sine:20um@5Hz", "--mode", "pid", "--duration", 0.1, "-o"),
        ("log", "record", "--duration", 0.01, "-o"),
        ("log", "export", "OTHER"),
        ("log", "recover", "OTHER", "-o"),
        ("gap", "next", "GAP", "-o"),
        ("log", "pull", "-o"),
        ("learn", "sine:30um@50Hz", "--model", "MODEL", "--trials", 1, "-o"),
    ],
)
def test_no_recording_is_written_over_unasked(run, tmp_path, stage_file, words):
    kept, other = tmp_path / "kept.h5", tmp_path / "other.h5"
    assert run("log", "record", "--duration", 0.01, "-o", other).status == 0
    (tmp_path / "gap.json").write_text(json.dumps(PROPOSAL))
    kept.write_bytes(b"an afternoon's work")
    places = {"OTHER": other, "GAP": tmp_path / "gap.json", "MODEL": stage_file}
    given = [places.get(word, word) for word in words]
    outcome = run(*given, kept)
    assert outcome.status == 2
    assert "exists already" in outcome.err
    assert "--overwrite" in outcome.err
    assert kept.read_bytes() == b"an afternoon's work"
    outcome = run(*given, kept, "--overwrite")
    assert "exists already" not in outcome.err
    if not {"recover", "pull"} & set(words):  # which have nothing to write here
        assert outcome.status == 0
        assert h5py.is_hdf5(kept)


def test_python_writes_nothing_over_either(tmp_path):
    with pl.connect() as dev:
        dev.record(duration=0.01, output=tmp_path / "kept.h5")
        with pytest.raises(pl.BadInput, match="overwrite=True"):
            dev.record(duration=0.01, output=tmp_path / "kept.h5")
        dev.record(duration=0.01, output=tmp_path / "kept.h5", overwrite=True)


def test_what_the_tables_do_not_cover_the_inverse_follows(run, stage_file):
    """`identify a larger one` was the advice, where another mode works."""
    words = ("triangle:60um@50Hz", "--model", stage_file, "--mode")
    outcome = run("track", *words, "ff+pid")
    assert outcome.status == 2
    (mode,) = re.findall(r"use --mode (\S+),", outcome.err)
    assert run("track", *words, mode).status == 0


def test_a_loop_that_ran_away_is_told_and_its_record_kept(run, tmp_path):
    outcome = run("track", *UNSTABLE, "-o", tmp_path / "run.h5")
    assert outcome.status == 4
    assert "the loop of x is unstable" in outcome.err
    assert f"the recording is kept in {tmp_path / 'run.h5'}" in outcome.err
    (advice,) = re.findall(r"`phaselead (explain \w+)`", outcome.err)
    explained = run(*advice.split())
    assert explained.status == 0
    assert "Cause:" in explained.out
    assert "What to do:" in explained.out
    assert run("replay", tmp_path / "run.h5").status == 0


@pytest.mark.parametrize(
    ("growth", "told"), [(1.2, True), (1.0, False), (0.8, False)], ids=["runs away", "rings on", "settles"]
)
def test_only_swings_that_grow_are_a_loop_that_ran_away(growth, told):
    t_s = np.arange(500) / 5000
    swings = growth ** (t_s * 400) * np.sin(2 * np.pi * 200 * t_s)
    found = growing_Hz(swings + 1e-4 * np.random.default_rng(1).normal(size=500), 1 / 5000)
    assert found == (pytest.approx(200, rel=0.1) if told else None)


def test_a_sensor_that_is_unplugged_is_no_loop_that_ran_away():
    assert growing_Hz(np.r_[np.zeros(100), np.linspace(0, 60, 20), np.full(5, 60.0)], 2e-4) is None


@pytest.mark.parametrize("name", fault_names())
def test_every_fault_is_explained_without_the_manual(name):
    text = explain_fault(name).text
    assert text.startswith("Cause: ")
    assert "](" not in text


def test_a_fault_by_nearly_its_name(run):
    assert run("explain").out.split() == fault_names()
    assert "did you mean tracking_error?" in run("explain", "track_error").err
    assert run("explain", "Tracking-Error").status == 0


def test_selftest_drives_nothing_unasked(run):
    outcome = run("selftest", "--axis", "x")
    assert outcome.status == 2
    for word in ("0 to 9.5 V", "amplifier NOT connected", "--yes"):
        assert word in outcome.err
    assert answered("n\n", "selftest", "--axis", "x").exit_code == 2
    tested = answered("y\n", "selftest", "--axis", "x")
    assert tested.exit_code == 1
    assert "a stage or an amplifier is connected" in " ".join(tested.stdout.split())


@pytest.mark.parametrize(
    ("gain", "misfit_V", "words"),
    [(0.02, 0.001, "no wire joins them"), (1.7, 0.6, "a stage or an amplifier"), (0.5, 0.001, "dividers")],
)
def test_selftest_says_what_is_wrong(gain, misfit_V, words):
    found = SelfTest({"x": LoopResult("x", gain, 0.0, misfit_V, 1.0)})
    assert words in str(found)
    assert SelfTest({"x": LoopResult("x", 1.0, 0.0, 0.001, 1.0)}).advice() == []


PROPOSAL = {
    "ties": [["creep", "delay"]],
    "next_experiment": {
        "waveform": "multisine", "level": 1.0, "band": [5.0, 500.0], "bias": 1.0, "axis": None, "seconds": 0.4,
        "separation": 9.0, "needs_sensor": None,
    },
}  # fmt: skip


def test_a_known_mode_is_not_swept_across_unasked(run, stage_file, tmp_path):
    (tmp_path / "gap.json").write_text(json.dumps(PROPOSAL))
    words = ("gap", "next", tmp_path / "gap.json", "--model", stage_file, "-o", tmp_path / "more.h5")
    outcome = run(*words)
    assert outcome.status == 2
    assert re.search(r"across its mode at (199\.\d|200(\.\d)?) Hz", outcome.err)
    assert not (tmp_path / "more.h5").exists()
    assert run(*words, "--yes", "--json", tmp_path / "facts.json").status == 0
    assert json.loads((tmp_path / "facts.json").read_text())["samples"] == 2000
    slow = {**PROPOSAL, "next_experiment": {**PROPOSAL["next_experiment"], "band": [5.0, 100.0]}}
    (tmp_path / "gap.json").write_text(json.dumps(slow))
    assert run(*words, "--overwrite").status == 0


def test_a_move_has_no_last_four_periods(run):
    said = run("track", "goto:30um", "--mode", "pid").out
    assert "whole record" in said
    assert "periods" not in said


@pytest.mark.parametrize(("f_Hz", "good"), [(2.5, True), (3.33, True), (3.0, False)])
def test_a_frequency_that_contradicts_the_files_own_times_is_refused(run, tmp_path, f_Hz, good):
    """2.5 Hz with the way back to the first row, 3.33 Hz without."""
    path = tmp_path / "path.csv"
    path.write_text("t_s,x_um\n0,0\n0.1,1\n0.2,3\n0.3,1\n")
    outcome = run("track", f"file:{path}@{f_Hz}Hz", "--mode", "pid")
    assert outcome.status == (0 if good else 2), outcome.err
    assert good or "a period of 0.4 s" in outcome.err


@pytest.mark.parametrize("axes", ["x,y", "xy", "x, y"])
def test_axes_are_named_alike_everywhere(run, axes):
    assert list(run("selftest", "--axis", axes, "--yes", "--json", "-").json["axes"]) == ["x", "y"]


@pytest.mark.parametrize("command", [("selftest", "--axis", "xq"), ("identify", "-o", "s.toml", "--axis", "x,x")])
def test_axes_that_are_none_are_refused_alike(run, command):
    outcome = run(*command)
    assert outcome.status == 2
    assert "name each of x, y, z at most once, e.g. x or x,y,z" in outcome.err


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (("trak",), "did you mean track?"),
        (("log", "recrod"), "record"),
        (("track", "sine:60um@5Hz", "--modle", "s"), "--model"),
        (("track", "sin:60um@5Hz"), "did you mean sine?"),
    ],
)
def test_did_you_mean(run, words, meant):
    outcome = run(*words)
    assert outcome.status == 2
    assert meant in outcome.err


def commands(group, path=()):
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


@pytest.mark.parametrize(("path", "command"), list(commands(main)))
def test_every_command_speaks_json(path, command):
    assert "--json" in {option for parameter in command.params for option in parameter.opts}


@pytest.mark.parametrize(
    "header",
    ["t_ms,u_mV,x_nm", "time,u,x", "Time (s),u_V,x [nm]", "t_s,u_V,x_mm", "t,ux,uy,x,y", "time (ms),r_um,u_V,x_um"],
)
def test_the_map_that_is_suggested_works(run, tmp_path, header):
    """One suggestion was followed by the next."""
    path = tmp_path / "rig.csv"
    t_s = np.arange(100) / 100
    columns = [1e3 * t_s if "ms" in header else t_s, *(np.sin(9 * t_s + i) for i in range(header.count(",")))]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="")
    outcome = run("log", "info", path)
    assert outcome.status == 2
    (suggested,) = re.findall(r"--map (\S+)", outcome.err)
    assert run("log", "info", path, "--map", suggested).status == 0


@pytest.mark.parametrize("header", ["Time (s),Drive (V),Sensor (um)", "Zeit,Spannung,Weg"])
def test_columns_that_nothing_is_known_of_are_sent_to_the_import(run, tmp_path, header):
    path = tmp_path / "rig.csv"
    t_s = np.arange(100) / 100
    np.savetxt(path, np.column_stack([t_s, t_s, 20 * t_s]), delimiter=",", header=header, comments="")
    outcome = run("fit", path, "-o", tmp_path / "s.toml")
    assert outcome.status == 2
    (words,) = re.findall(r"`phaselead (log import [^`]+)`", outcome.err)
    words = words.replace("OUT.h5", str(tmp_path / "out.h5")).split()
    assert run(*words).status == 0


ENDED = "the virtual stage has ended"


@pytest.mark.parametrize(
    "words",
    [
        ("arm",),
        ("upload", "MODEL"),
        ("upload", "MODEL", "--persist"),
        ("log", "trigger"),
        ("limits", "--axis", "x", "--u-max", "8V"),
        ("hold",),
    ],
)
def test_what_ends_with_a_virtual_stage_is_told(run, stage_file, words):
    """They did their work on a stage that was gone a moment later, and said nothing."""
    given = [stage_file if word == "MODEL" else word for word in words]
    outcome = run(*given)
    assert outcome.status == 0, outcome
    assert ENDED in outcome.out
    assert ENDED not in run(*given, "--json", "-").out


@pytest.mark.parametrize("words", [("upload", "MODEL", "--persist"), ("limits", "--axis", "x", "--u-max", "8V")])
def test_what_its_flash_keeps_is_not(run, stage_file, tmp_path, words):
    given = [stage_file if word == "MODEL" else word for word in words]
    outcome = run(*given, "--port", f"sim://xyz250?state={tmp_path / 'flash.bin'}")
    assert outcome.status == 0, outcome
    assert ENDED not in outcome.out
    joined = run(*given, "--port", "sim://xyz250?seed=3").out
    assert "sim://xyz250?seed=3&state=flash.bin" in "".join(joined.split("\n"))
