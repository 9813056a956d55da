"""Bad input through the command line: one line with what is wrong and what to do, no traceback, nothing written."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import phaselead as pl
from phaselead.device.capture import DeviceFault, capture
from phaselead.device.flash import check_before_upload
from phaselead.errors import BadInput, DeviceRefused
from phaselead.record.axis_record import AxisRecord
from phaselead.record.exporting import write_csv
from phaselead.record.recording import Recording

RATE_HZ = 1000.0


def sine_rows(periods: float = 10.0) -> np.ndarray:
    """t_s, u_V, x_um of a clean 5 Hz sine."""
    t_s = np.arange(round(periods / 5.0 * RATE_HZ)) / RATE_HZ
    phase = 2 * np.pi * 5.0 * t_s
    return np.column_stack([t_s, 2.5 - 2.5 * np.cos(phase), 50 - 50 * np.cos(phase - 0.1)])


def write(path: Path, rows: np.ndarray, header: str = "t_s,u_V,x_um") -> Path:
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def with_nan(rows):
    rows[100, 1] = np.nan


def with_jump_in_time(rows):
    rows[500:, 0] += 0.0005


def clipped(rows):
    rows[:, 2] = np.minimum(rows[:, 2], 80.0)


def with_constant_voltage(rows):
    rows[:, 1] = 1.0


BENT = {
    "nan": (with_nan, "t_s,u_V,x_um", ("line 102", "u_V")),
    "time": (with_jump_in_time, "t_s,u_V,x_um", ("not uniform", "0.0015 s")),
    "units": (lambda rows: None, "t_ms,u_mV,x_um", ("t_ms", "--map")),
    "no-header": (lambda rows: None, "0,0,0", ("no header", "--map")),
    "clipped": (clipped, "t_s,u_V,x_um", ("clipped at 80 um", "less swing")),
    "constant": (with_constant_voltage, "t_s,u_V,x_um", ("never moves", "driven")),
}


def assert_one_line(outcome, status: int, *words: str) -> None:
    assert outcome.status == status, outcome
    assert outcome.error is None
    assert outcome.err.startswith("phaselead: ")
    assert outcome.err.count("\n") == 1
    for word in words:
        assert word in outcome.err


def test_a_stage_file_in_place_of_a_recording_is_told(run, stage_file):
    outcome = run("fit", stage_file, "-o", "never.toml")
    assert_one_line(outcome, 2, "is a stage file", "give a recording")


@pytest.mark.parametrize("name", BENT)
def test_bent_recordings_are_refused_by_fit_and_verify(run, stage_file, tmp_path, name):
    bend, header, words = BENT[name]
    rows = sine_rows()
    bend(rows)
    path = write(tmp_path / f"{name}.csv", rows, header)
    assert_one_line(run("fit", path, "-o", tmp_path / "out.toml"), 2, *words)
    assert_one_line(run("verify", "--model", stage_file, path, "--json", tmp_path / "out.json"), 2)
    assert sorted(os.listdir(tmp_path)) == [path.name]


def test_too_few_periods_are_refused(run, tmp_path):
    path = write(tmp_path / "short.csv", sine_rows(0.7))
    assert_one_line(run("fit", path, "-o", tmp_path / "out.toml"), 2, "period")
    assert not (tmp_path / "out.toml").exists()


def test_a_failed_fit_leaves_an_old_stage_file_as_it_was(run, stage_file, tmp_path):
    old = tmp_path / "stage.toml"
    old.write_bytes(stage_file.read_bytes())
    rows = sine_rows()
    with_nan(rows)
    assert run("fit", write(tmp_path / "nan.csv", rows), "-o", old).status == 2
    assert old.read_bytes() == stage_file.read_bytes()


STAGE_EDITS = {
    "missing": ("\ngain_um_per_V = ", "\n# gain_um_per_V = ", ("gain_um_per_V", "missing")),
    "unknown": ("[axes.x.time]", "[axes.x.time]\nflavour = 1", ("flavour", "unknown")),
    "range": ("rest_fraction = ", "rest_fraction = 3 # ", ("rest_fraction",)),
    "monotone": ("a_um_per_V = ", "a_um_per_V = [-1.0, 0.1, 0.2] # ", ("monotone",)),
    "newer": ("version = 1", "version = 99", ("newer", "update")),
}


@pytest.mark.parametrize("name", STAGE_EDITS)
def test_bent_stage_files_are_refused_wherever_one_is_read(run, stage_file, tmp_path, name):
    before, after, words = STAGE_EDITS[name]
    text = stage_file.read_text()
    assert before in text
    bent = tmp_path / "bent.toml"
    bent.write_text(text.replace(before, after, 1))
    record = write(tmp_path / "record.csv", sine_rows())
    assert_one_line(run("upload", bent), 2, "bent.toml", *words)
    assert_one_line(run("track", "sine:60um@5Hz", "--model", bent), 2, *words)
    assert_one_line(run("verify", "--model", bent, record), 2, *words)
    assert_one_line(run("predict", "--model", bent, record, "-o", tmp_path / "out.csv"), 2, *words)
    assert_one_line(run("status", "--port", f"sim://{bent}"), 2, *words)
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(
    ("wave", "options", "words"),
    [
        ("sine:600um@5Hz", (), ("270", "smaller swing")),
        ("sine:260um@5Hz", (), ("um",)),
        ("sine:60um@50Hz", (), ("50 Hz", "1..20 Hz")),
        ("sine:60um@0.1Hz", (), ("0.1 Hz",)),
        ("sine:2um@5Hz", (), ("um",)),
        ("sine:60um", (), ("frequency", "sine:60um@5Hz")),
        ("sine:-60um@5Hz", (), ("above 0",)),
        ("wiggle:60um@5Hz", (), ("wiggle", "sine:60um@5Hz")),
        ("sine:60V@5Hz", ("--mode", "open"), ("10 V",)),
        ("sine:10V@400Hz", ("--mode", "open"), ("V/s",)),
        ("sine:5V@5Hz", (), ("--mode open",)),
        ("sine:5um@5Hz", ("--mode", "open"), ("volts",)),
        ("x=sine:60um@5Hz,q=sine:60um@5Hz", (), ("q",)),
        ("file:nowhere.csv@5Hz", (), ("nowhere.csv",)),
        ("sine:60um@5Hz", ("--gains", "1,2"), ("KP,KI,KD",)),
        ("sine:60um@5Hz", ("--gains", "1e9,0,0"), ("not stable", "gain margin", "--force")),
        ("sine:60um@5Hz", ("--duration", "0"), ("tick",)),
        ("sine:60um@5Hz", ("--duration", "-1"), ()),
    ],
)
def test_paths_that_cannot_be_driven_are_refused_before_anything_moves(run, stage_file, tmp_path, wave, options, words):
    output = tmp_path / "run.h5"
    outcome = run("track", wave, "--model", stage_file, "-o", output, *options)
    assert_one_line(outcome, 2, *words)
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize(
    ("port", "status", "words"),
    [
        ("/dev/does-not-exist", 3, ("does not exist", "phaselead ports")),
        ("sim://nothing", 2, ("sim://xyz250",)),
        ("sim://nowhere.toml", 2, ("nowhere.toml",)),
        ("sim://xyz250?seed=x", 2, ("seed",)),
        ("sim://xyz250?colour=1", 2, ("colour",)),
    ],
)
def test_ports_that_are_none(run, port, status, words):
    assert_one_line(run("status", "--port", port), status, *words)


def test_a_file_is_no_port(run, tmp_path):
    path = write(tmp_path / "record.csv", sine_rows())
    assert_one_line(run("status", "--port", path), 3, "not a serial port")


def test_a_recording_that_no_device_made_cannot_be_replayed(run, tmp_path):
    path = write(tmp_path / "record.csv", sine_rows())
    assert_one_line(run("replay", path), 2)
    converted = tmp_path / "record.h5"
    assert run("log", "export", path, converted).status == 0
    assert_one_line(run("replay", converted), 2, "/replay")


def test_export_does_not_write_over_a_file_unasked(run, tmp_path):
    path = write(tmp_path / "record.csv", sine_rows())
    there = tmp_path / "there.mat"
    there.write_text("mine")
    assert_one_line(run("log", "export", path, there), 2, "exists")
    assert there.read_text() == "mine"
    assert run("log", "export", path, there, "--overwrite").status == 0


def test_an_export_of_a_window_holds_the_window(run, tmp_path):
    """It began with the rows that only warm up a memory: of @0.5:1 it was 0 to 1 s."""
    path = write(tmp_path / "record.csv", sine_rows())
    assert run("log", "export", f"{path}@0.5:1", tmp_path / "part.csv", "--json", "-").json["samples"] == 500
    assert run("log", "info", tmp_path / "part.csv", "--json", "-").json["from_s"] == 0.5
    pl.export(f"{path}@0.5:1", tmp_path / "here.csv")
    assert (tmp_path / "here.csv").read_bytes() == (tmp_path / "part.csv").read_bytes()


def test_the_model_of_another_stage_is_warned_of(run, tmp_path):
    path = write(tmp_path / "record.csv", sine_rows())
    assert run("fit", path, "-o", tmp_path / "s.toml").status == 0
    rows = sine_rows()
    for factor, warned in ((1.2, False), (15, True)):
        other = write(tmp_path / f"{factor}.csv", rows * (1, factor, 1))
        for words in (("verify",), ("predict", "-o", tmp_path / f"p{factor}.csv")):
            outcome = run(*words, "--model", tmp_path / "s.toml", other)
            assert outcome.status == 0
            assert ("is driven with 0..75 V, its model was fitted on 0..5 V" in outcome.err) is warned


def test_times_in_milliseconds_are_doubted(run, tmp_path):
    """predict made a record of another stage of them, without a word."""
    rows = sine_rows()
    path, late = write(tmp_path / "record.csv", rows), write(tmp_path / "ms.csv", rows * (1e3, 1, 1))
    assert run("fit", path, "-o", tmp_path / "s.toml").status == 0
    for record, warned in ((path, False), (late, True)):
        for words in (("verify",), ("predict", "-o", tmp_path / f"{warned}.csv")):
            outcome = run(*words, "--model", tmp_path / "s.toml", record)
            assert outcome.status == 0
            assert ("are its times in ms?" in outcome.err) is warned


def test_metres_are_doubted_as_nanometres_are(run, tmp_path):
    """A column x_um in metres was fitted without a word, one in nanometres with a warning."""
    for factor in (1e3, 1e-6):
        path = write(tmp_path / "record.csv", sine_rows() * (1, 1, factor))
        outcome = run("fit", path, "-o", tmp_path / f"{factor}.toml")
        assert "factor" in outcome.out + outcome.err


def test_millivolts_are_doubted(run, tmp_path):
    """The line only asked for limits."""
    path = write(tmp_path / "record.csv", sine_rows() * (1, 1e3, 1))
    outcome = run("fit", path, "-o", tmp_path / "s.toml")
    assert "is it in millivolts? Map it with its factor, u_V=COLUMN*1e-3" in outcome.out + outcome.err


def test_a_picture_is_no_file_of_columns(run, tmp_path):
    """Its bytes were quoted."""
    path = tmp_path / "error.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\n1 2 3\n4 5 6\n")
    assert_one_line(run("log", "import", path), 2, "neither text nor .npy")


@pytest.mark.parametrize("words", [("status",), ("gap", "next", "gap.json", "-o", "more.h5")])
def test_an_empty_port_is_refused(run, words, monkeypatch):
    """An unset variable of a script drove the virtual stage."""
    assert_one_line(run(*words, "--port", ""), 2, "--port is empty")


def test_frozen_and_refit_exclude_each_other(run, tmp_path):
    assert_one_line(run("gap", "--frozen", "--refit", "--model", "m.toml"), 2, "give one of them")


def test_a_minus_is_no_file(run, tmp_path, monkeypatch):
    """predict -o - wrote a file of this name."""
    path = write(tmp_path / "record.csv", sine_rows())
    pl.load("sim://xyz250").save(tmp_path / "any.toml")
    monkeypatch.chdir(tmp_path)
    assert_one_line(run("predict", "--model", tmp_path / "any.toml", path, "-o", "-"), 2, "give a file name")
    assert not Path("-").exists()


def test_an_output_folder_that_is_missing_is_told_before_anything_moves(run, stage_file, tmp_path):
    outcome = run("track", "sine:60um@5Hz", "--model", stage_file, "-o", tmp_path / "no" / "run.h5")
    assert_one_line(outcome, 2, "folder")


def test_rate_is_proposed_only_for_times_without_missing_samples(run, tmp_path):
    rows = np.delete(sine_rows(), np.s_[700:710], axis=0)
    path = write(tmp_path / "missing.csv", rows)
    outcome = run("log", "info", path)
    assert_one_line(outcome, 2, "line 702", "samples are missing")
    assert "--rate" not in outcome.err
    assert_one_line(run("log", "info", path, "--rate", "1000Hz"), 2, "line 702", "samples are missing")


@pytest.fixture(name="gapped")
def _gapped(run, tmp_path_factory) -> Path:
    """A run of which 50 ticks were lost, as a capture with a gap is written."""
    path = tmp_path_factory.mktemp("gapped") / "gapped.h5"
    assert run("log", "record", "--drive", "sine:5V@5Hz", "--duration", "0.6", "-o", path).status == 0
    with h5py.File(path, "r+") as file:
        start = int(file.attrs["start_tick"])
        at = int(np.flatnonzero(file["device/tick"][()] == start + 1000)[0])
        lose_rows(file["device"], at)
        for name in ("t_s", "u_V", "x_um"):
            lose_rows(file, 1000, (name,))
        gaps = json.dumps([[start + 1000, 50]])
        file["replay"].attrs["gaps.json"] = gaps
        file.attrs["gaps.json"] = gaps
    return path


def lose_rows(group: h5py.Group, at: int, names: tuple[str, ...] | None = None) -> None:
    """Deletes rows at..at+50 of every dataset in the group, or of those named."""
    for name in names or tuple(group):
        if isinstance(group[name], h5py.Group):
            lose_rows(group[name], at)
            continue
        values, attributes = group[name][()], dict(group[name].attrs)
        del group[name]
        group.create_dataset(name, data=np.delete(values, np.s_[at : at + 50]))
        group[name].attrs.update(attributes)


def test_a_gapped_run_can_be_looked_into_and_exported(run, gapped, tmp_path):
    outcome = run("log", "info", gapped, "--json", "-")
    assert outcome.status == 0, outcome.err
    assert outcome.json["rate_Hz"] == pytest.approx(5000)
    ((first, ticks),) = outcome.json["gaps"]
    assert ticks == 50
    assert_one_line(run("replay", gapped), 2, "gap", f"ticks from {first} on are missing")
    assert run("log", "export", gapped, tmp_path / "gapped.csv").status == 0
    assert_one_line(run("log", "info", tmp_path / "gapped.csv"), 2, "samples are missing")


def test_a_gap_is_found_in_the_ticks_when_the_file_does_not_tell_of_it(run, gapped, tmp_path):
    silent = tmp_path / "silent.h5"
    silent.write_bytes(gapped.read_bytes())
    with h5py.File(silent, "r+") as file:
        told = json.loads(file.attrs["gaps.json"])
        file.attrs["gaps.json"] = file["replay"].attrs["gaps.json"] = "[]"
    assert run("log", "info", silent, "--json", "-").json["gaps"] == told
    assert_one_line(run("replay", silent), 2, f"ticks from {told[0][0]} on are missing")


def test_nothing_is_fitted_to_or_judged_on_a_gapped_run(run, stage_file, gapped, tmp_path):
    model = ("--model", stage_file)
    assert_one_line(run("fit", gapped, "-o", tmp_path / "out.toml"), 2, "gap", "record it again")
    assert_one_line(run("predict", gapped, *model, "-o", tmp_path / "out.csv"), 2, "gap")
    for view in ("time", "table"):
        assert_one_line(run("verify", gapped, *model, "--view", view), 2, "gap")
    assert not os.listdir(tmp_path)


def test_outputs_are_checked_before_anything_is_read_or_driven(run, stage_file, tmp_path):
    """No input named here exists and no port is there: that is told only when the output is good."""
    nothing = tmp_path / "nothing.csv"
    port = ("--port", "/dev/does-not-exist")
    for arguments, ending in (
        (("fit", nothing, "-o"), ".toml"),
        (("identify", *port, "-o"), ".toml"),
        (("predict", nothing, "--model", nothing, "-o"), ".csv"),
        (("track", "sine:5V@5Hz", "--mode", "open", *port, "-o"), ".h5"),
        (("log", "record", *port, "-o"), ".h5"),
        (("log", "recover", nothing, "-o"), ".h5"),
        (("log", "export", nothing), ".csv"),
    ):
        assert_one_line(run(*arguments, tmp_path / "out.txt"), 2, "out.txt", ending)
        assert_one_line(run(*arguments, tmp_path / "no" / f"out{ending}"), 2, "no folder")
        good = tmp_path / f"out{ending}"
        assert_one_line(run(*arguments, good, "--json", tmp_path / "no" / "out.json"), 2, "no folder", "out.json")
        assert good.name not in run(*arguments, good).err
    assert not os.listdir(tmp_path)


def test_an_input_is_never_written_over(run, stage_file, tmp_path):
    path = write(tmp_path / "record.csv", sine_rows())
    before = path.read_bytes()
    assert_one_line(run("predict", f"{path}@0.5:1", "--model", stage_file, "-o", path), 2, "one of the inputs")
    assert_one_line(run("log", "export", path, path, "--overwrite"), 2, "one of the inputs")
    toml = tmp_path / "record.toml"
    toml.write_bytes(before)
    assert_one_line(run("fit", toml, "-o", toml), 2, "one of the inputs")
    assert path.read_bytes() == toml.read_bytes() == before


def test_a_refused_run_leaves_no_journal(run, tmp_path, monkeypatch):
    def refused(*_arguments, **_named):
        raise DeviceRefused("the device refused to arm; park it first")

    monkeypatch.setattr("phaselead.device.capture.read_model", refused)
    drive = ("log", "record", "--drive", "sine:5V@5Hz", "--duration", "0.2", "-o", tmp_path / "run.h5")
    assert_one_line(run(*drive), 4, "park it first")
    assert not os.listdir(tmp_path)


def test_an_error_after_motion_keeps_the_journal_and_says_how_to_recover_it(run, tmp_path, monkeypatch):
    def failing(*_arguments, **_named):
        raise BadInput("run.h5: cannot be written (No space left on device)")

    output, journal = tmp_path / "run.h5", tmp_path / "run.h5.journal"
    drive = ("log", "record", "--drive", "sine:5V@5Hz", "--duration", "0.2", "-o", output)
    with monkeypatch.context() as patch:
        patch.setattr("phaselead.control.journal.convert", failing)
        assert_one_line(run(*drive), 2, "No space", f"phaselead log recover {journal} -o {output}")
    assert os.listdir(tmp_path) == [journal.name]
    assert_one_line(run(*drive), 2, "not finished", "log recover")
    assert_one_line(run("log", "recover", journal, "-o", journal), 2)
    assert run("log", "recover", journal, "-o", output).status == 0
    assert os.listdir(tmp_path) == [output.name]


def test_an_interrupt_says_what_is_kept(run, tmp_path, monkeypatch):
    def interrupted(*_arguments, **_named):
        patch.undo()
        raise KeyboardInterrupt

    output, patch = tmp_path / "run.h5", monkeypatch
    patch.setattr("phaselead.device.capture.wait_parked", interrupted)
    drive = ("log", "record", "--drive", "sine:5V@5Hz", "--duration", "0.2", "-o", output)
    assert_one_line(run(*drive), 130, "phaselead: interrupted; the output is parked; ", f"log recover {output}.journal")


def test_a_fault_run_is_written_and_leaves_no_journal(run, tmp_path, monkeypatch):
    def fault(*arguments, **named):
        raise DeviceFault("the device latched a fault", capture(*arguments, **named))

    monkeypatch.setattr("phaselead.device.device.capture", fault)
    drive = ("log", "record", "--drive", "sine:5V@5Hz", "--duration", "0.2", "-o", tmp_path / "run.h5")
    assert_one_line(run(*drive), 4, "fault")
    assert os.listdir(tmp_path) == ["run.h5"]
    assert run("replay", tmp_path / "run.h5").status == 0


def test_json_goes_into_a_pipe_by_name(tmp_path):
    path = write(tmp_path / "record.csv", sine_rows())
    command = [sys.executable, "-m", "phaselead", "log", "info", path, "--json", "/dev/stdout"]
    outcome = subprocess.run(command, capture_output=True, text=True, check=False)
    assert outcome.returncode == 0, outcome.stderr
    assert '"samples": 2000' in outcome.stdout


def test_lines_say_what_to_do_next(run, stage_file, tmp_path):
    path = write(tmp_path / "record.csv", sine_rows())
    assert_one_line(run("log", "recover", path, "-o", tmp_path / "out.h5"), 2, "no capture journal; give")
    assert_one_line(run("upload", path), 2, "a stage file (.toml) has keys; is it a recording?")
    assert_one_line(run("log", "info", f"{path}@50:60"), 2, "0 rows", "0 to 1.999 s, choose FROM:TO inside")
    assert_one_line(run("replay", tmp_path / "nope.h5"), 2, "does not exist; check the path")
    assert_one_line(run("replay", path), 2, "is no HDF5 file; give a run")


def test_a_voltage_that_stands_at_its_limit_is_legitimate(run, tmp_path):
    rows = sine_rows()
    t_s, rows[:, 1] = rows[:, 0], np.minimum(rows[:, 1], 4.0)
    rows[:, 2] = 20 * rows[:, 1] + 2 * np.sin(2 * np.pi * 5.0 * t_s)
    path = write(tmp_path / "limited.csv", rows)
    assert run("fit", path, "--base", "linear", "-o", tmp_path / "out.toml").status == 0


@pytest.mark.parametrize(
    ("port", "words"),
    [
        ("sim://xyz250", ("is no board", "--port")),
        ("qemu://nucleo_f446re", ("is no board", "--check-only")),
        ("/dev/no-such-board", ("no such port", "plugged in")),
    ],
)
def test_flash_builds_nothing_where_there_is_no_board(run, port, words):
    assert_one_line(run("flash", "--port", port), 2, *words)


def test_flash_says_what_it_uploads_with(tmp_path, monkeypatch):
    (tmp_path / ".pio-core").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadInput, match="apt install openocd"):
        check_before_upload(tmp_path, "/dev/null")


def test_a_model_of_more_volts_is_taken_and_drives_within_its_limits(run, tmp_path):
    """docs/measured-data.md: one of +-150 V is uploaded with the limits of a new stage file, which refuse the path."""
    t_s = np.arange(2000) / 1000
    u_V = 150 * np.sin(2 * np.pi * t_s)
    write_csv(tmp_path / "high.csv", Recording(t_s=t_s, axes={"x": AxisRecord(u_V=u_V, x_um=0.1 * u_V)}))
    model = tmp_path / "high.toml"
    assert run("fit", tmp_path / "high.csv", "--base", "linear", "-o", model).status == 0
    assert run("upload", model).status == 0
    assert_one_line(run("track", "sine:100V@1Hz", "--mode", "open", "--model", model), 2, "(-2..10 V)")


def test_of_a_window_it_is_said_what_is_judged_and_what_warms_up(run, tmp_path):
    t_s = np.arange(1000) / 1000
    write_csv(tmp_path / "rec.csv", Recording(t_s=t_s, axes={"x": AxisRecord(u_V=t_s, x_um=t_s)}))
    part = run("log", "info", f"{tmp_path / 'rec.csv'}@0.2:0.6")
    assert "judged samples 400" in " ".join(part.out.split())
    assert "warm up" in part.out
    told = run("log", "info", f"{tmp_path / 'rec.csv'}@0.2:0.6", "--json", "-").json
    assert (told["judged_samples"], told["judged_from_s"], told["judged_to_s"]) == (400, 0.2, pytest.approx(0.599))
    whole = run("log", "info", tmp_path / "rec.csv").out
    assert "judged" not in whole
    assert "warm up" not in whole
