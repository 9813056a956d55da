"""Files of other programs: read whatever their form, mapped by name or guessed, and every assumption said."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

import phaselead as pl
from phaselead.cli import main
from phaselead.record import doubts_about, from_columns
from phaselead.record.foreign import ForeignColumn
from phaselead.record.guess import unit_of

ROWS = 400
t_s = np.arange(ROWS) / 1000
u_V = 2.5 - 2.5 * np.cos(2 * np.pi * 5 * t_s)
x_um = 20 * u_V + 0.02 * np.random.default_rng(1).normal(size=ROWS) + 3
DATA = Path(os.environ.get("PHASELEAD_DATA", "nowhere"))


def same(found: pl.Recording, digits: float = 1e-6) -> None:
    assert np.allclose(found.t_s, t_s, atol=1e-9)
    assert np.allclose(found.u_V, u_V, atol=digits)
    assert np.allclose(found.x_um, x_um, atol=digits)


def named(volts: np.ndarray, micrometres: np.ndarray, **more: np.ndarray) -> pl.Recording:
    return from_columns({"t_s": t_s, "u_V": volts, "x_um": micrometres, **more})


def text(delimiter: str, comma: bool, *columns: np.ndarray) -> str:
    lines = (delimiter.join(f"{value:.9f}" for value in row) for row in np.column_stack(columns))
    return "\n".join(line.replace(".", ",") if comma else line for line in lines) + "\n"


HEADINGS = {
    "units as words": (("time ms", "drive mV", "sensor nm"), (1e3, 1e3, 1e3)),
    "units in brackets": (("Time (ms)", "Drive [mV]", "Sensor (nm)"), (1e3, 1e3, 1e3)),
    "units after a slash": (("Zeit / s", "Spannung / V", "Weg / \u00b5m"), (1, 1, 1)),
    "units after an underscore": (("t_ms", "u_mV", "x_nm"), (1e3, 1e3, 1e3)),
    "words alone": (("Time", "Voltage", "Position"), (1, 1, 1)),
    "metres without a unit": (("time", "command", "displacement"), (1, 1, 1e-6)),
    "other order of words": (("timestamp", "Input Voltage (V)", "Output position (um)"), (1, 1, 1)),
}


@pytest.mark.parametrize("comma", [False, True], ids=["point", "comma"])
@pytest.mark.parametrize("delimiter", [";", "\t", "   ", ","], ids=["semicolon", "tab", "blanks", "comma-separated"])
@pytest.mark.parametrize("name", HEADINGS)
def test_text_of_any_form(tmp_path, name, delimiter, comma):
    if comma and delimiter == ",":
        return
    labels, factors = HEADINGS[name]
    columns = [values * factor for values, factor in zip((t_s, u_V, x_um), factors, strict=True)]
    rows = text(delimiter, comma, *columns) if factors[2] > 1e-3 else _scientific(delimiter, comma, columns)
    (tmp_path / "rig.txt").write_text(delimiter.join(labels) + "\n" + rows, encoding="utf-8")
    same(pl.import_recordings(tmp_path / "rig.txt").recordings[0])


def test_a_decimal_comma_below_rows_of_whole_numbers(tmp_path):
    """Of a record that begins at rest: 0;0;0 has no comma, and every number below it was taken for none."""
    path = tmp_path / "rig.csv"
    path.write_text("t_s;u_V;x_um\n0;0;0\n" + "".join(f"0,{i:03};{i},5;{2 * i},25\n" for i in range(1, 40)))
    (recording,) = pl.import_recordings(path).recordings
    assert recording.t_s[-1] == 0.039
    assert recording.x_um[1] == 2.25


def _scientific(delimiter: str, comma: bool, columns: list[np.ndarray]) -> str:
    lines = (delimiter.join(f"{value:.12e}" for value in row) for row in np.column_stack(columns))
    return "\n".join(line.replace(".", ",") if comma else line for line in lines) + "\n"


@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1", "utf-16"])
def test_what_a_spreadsheet_exports(tmp_path, encoding):
    head = "Messung vom 3.5.\n\nZeit;Spannung;Weg\nms;mV;\u00b5m\n"
    (tmp_path / "rig.csv").write_bytes((head + text(";", True, 1e3 * t_s, 1e3 * u_V, x_um)).encode(encoding))
    same(pl.import_recordings(tmp_path / "rig.csv").recordings[0])


def test_commas_between_values_and_in_decimals_are_refused(tmp_path):
    """Which comma parts values nobody can know; the seconds became volts."""
    path = tmp_path / "both.csv"
    rows = "".join(f"{i // 50},{i % 50:02d},{i % 7},5,{20 + i % 9}\n" for i in range(100))
    path.write_text("t_s,u_V,x_um\n0,1,2,40\n" + rows, "utf-8")
    with pytest.raises(pl.BadInput, match=r"line 3: has 5 fields, 4 expected.*another delimiter"):
        pl.import_recordings(path, rate=100.0)


def test_columns_without_names_are_told_by_their_numbers(tmp_path):
    """Even steps are time; what was commanded is smoother than what a sensor saw; what stands still is left out."""
    still = np.full(ROWS, 7.0)
    (tmp_path / "rig.dat").write_text(text("\t", False, still, x_um, t_s, still, u_V))
    found = pl.import_recordings(tmp_path / "rig.dat")
    same(found.recordings[0])
    said = str(found)
    for words in ("rises in even steps", "smoothest", "rougher than the voltage", "left out: column 1, 4"):
        assert words in said


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ("t_s=1,u_V=2,x_um=3", None),
        ("t_s=1,u_V=3,x_um=2", "are the columns exchanged?"),
        ("t_s=1,u_V=2,x_um=3*1e6", "which no piezo stage does"),
    ],
)
def test_a_map_that_looks_wrong_is_told_by_what_reads_it(tmp_path, columns, words):
    (tmp_path / "rig.csv").write_text(text(",", False, t_s, u_V, x_um))
    model, kept = str(tmp_path / "o.toml"), str(tmp_path / "o.h5")
    fitted = CliRunner().invoke(main, ["fit", str(tmp_path / "rig.csv"), "--map", columns, "-o", model])
    imported = CliRunner().invoke(main, ["log", "import", str(tmp_path / "rig.csv"), "--map", columns, "-o", kept])
    assert (fitted.exit_code, imported.exit_code) == (0, 0)
    for said in (fitted.stdout, imported.stdout):
        assert said.count("exchanged") <= 1
        assert ("exchanged" in said, "piezo" in said) == ("exchanged" in (words or ""), "piezo" in (words or ""))
        assert words is None or words in " ".join(said.split())


def test_exchanged_columns_are_told_by_a_fit_whatever_they_are_called(tmp_path):
    """With our own names in the header no map was there to be doubted, and 0.046 um/V went without a word."""
    assert "are the columns exchanged?" in " ".join(str(pl.fit(named(x_um, u_V))).split())
    assert "exchanged" not in str(pl.fit(named(u_V, x_um)))


def test_exchanged_columns_of_many_records_are_told_in_one_line():
    (line,) = [line for line in pl.fit([named(x_um, u_V)] * 3).report.messages if "exchanged" in line]
    assert "(2 more like it)" in line


def test_what_cannot_be_exchanged_or_is_no_smoother_is_in_no_doubt():
    """A loop puts its sensor's noise into the voltage; a device's own recording has its columns where they belong."""
    assert doubts_about(named(x_um, u_V))
    assert not doubts_about(named(x_um, u_V, r_um=u_V))
    assert not doubts_about(replace(named(x_um, u_V), meta={"target": "host"}))


def test_a_coarse_converter_is_no_sensor():
    """A small slow sweep in steps of 12 bits, on a stage that creeps much farther and has a fine sensor."""
    time_s = np.arange(4000) / 1e3
    drive_V = 2 * np.sin(2 * np.pi * 5 * time_s)
    position_um = 2 * drive_V + 10 * time_s + 1e-3 * np.random.default_rng(5).normal(size=len(time_s))
    step_V = 20 / 4096
    coarse_V = np.round(drive_V / step_V) * step_V
    assert not doubts_about(from_columns({"t_s": time_s, "u_V": coarse_V, "x_um": position_um}))
    noisy_V = np.random.default_rng(6).normal(drive_V, 2 * step_V)
    sensor_V = np.round(noisy_V / step_V) * step_V
    assert doubts_about(from_columns({"t_s": time_s, "u_V": sensor_V, "x_um": position_um}))


def test_arrays_of_numpy_and_matlab(tmp_path):
    np.savez(tmp_path / "rig.npz", time=t_s, drive_V=u_V, sensor_nm=1e3 * x_um)
    savemat(tmp_path / "rig.mat", {"data": {"t": t_s, "u": u_V, "x": x_um}, "gain": 2.0})
    with h5py.File(tmp_path / "73.mat", "w") as file:
        file["t"], file["voltage"], file["position"] = t_s[None, :], u_V[None, :], x_um[None, :]
    for name in ("rig.npz", "rig.mat", "73.mat"):
        same(pl.import_recordings(tmp_path / name).recordings[0])
    np.save(tmp_path / "rig.npy", np.column_stack([u_V, x_um]))
    same(pl.import_recordings(tmp_path / "rig.npy", rate="1kHz").recordings[0])
    with pytest.raises(pl.BadInput, match="--rate"):
        pl.import_recordings(tmp_path / "rig.npy")


def test_voltages_in_one_file_and_positions_in_another(tmp_path):
    """Rows, channels, recordings, periods, as one bench keeps them."""
    u = np.random.default_rng(2).normal(size=(64, 3, 2, 2))
    np.save(tmp_path / "u_train.npy", u)
    np.save(tmp_path / "y_train.npy", 3e-6 * u)
    found = pl.import_recordings([tmp_path / "u_train.npy", tmp_path / "y_train.npy"], rate=6400)
    assert len(found.recordings) == 2
    second = found.recordings[1]
    assert np.allclose(second.uz_V, np.r_[u[:, 2, 1, 0], u[:, 2, 1, 1]])
    assert np.allclose(second.z_um, 3 * second.uz_V)
    assert "2 recordings, 2 periods one after the other" in str(found)


def test_mapped_by_name(tmp_path):
    (tmp_path / "rig.csv").write_text("A,B,C\n" + text(",", False, x_um, t_s, u_V))
    found = pl.import_recordings(tmp_path / "rig.csv", map="t_s=B,u_V=3,x_um=A*1")
    same(found.recordings[0])
    with pytest.raises(pl.BadInput, match="there is no column 'D'"):
        pl.import_recordings(tmp_path / "rig.csv", map="u_V=D,x_um=A")


def test_a_sensor_that_counts_backwards_is_noticed(tmp_path):
    (tmp_path / "rig.csv").write_text("time,voltage,position\n" + text(",", False, t_s, u_V, -x_um))
    found = pl.import_recordings(tmp_path / "rig.csv")
    assert "counts backwards" in str(found)
    flipped = pl.import_recordings(tmp_path / "rig.csv", flip=True)
    assert "counts backwards" not in str(flipped)
    same(flipped.recordings[0])


@given(
    st.sampled_from(["ms", "s", "mV", "V", "nm", "um", "\u00b5m", "mm"]),
    st.sampled_from(["{} ({})", "{} [{}]", "{}/{}", "{}_{}"]),
)
def test_a_unit_is_found_however_it_is_written(unit, form):
    column = ForeignColumn(1, form.format("signal", unit), np.zeros(3))
    assert unit_of(column) == unit.replace("\u00b5", "u")


@pytest.mark.parametrize("content", [b"", b"a b c\n", b"\x93NUMPYxx", b"MATLAB 5.0 nonsense", b"1;2\n3\n4;5\n"])
def test_what_holds_no_columns_is_refused_in_one_line(tmp_path, content):
    (tmp_path / "rig").write_bytes(content)
    result = CliRunner().invoke(main, ["log", "import", str(tmp_path / "rig"), "-o", str(tmp_path / "out.h5")])
    assert result.exit_code == 2
    assert result.stderr.startswith("phaselead: ")
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "out.h5").exists()


def test_the_command_previews_then_writes_and_nothing_over(tmp_path):
    (tmp_path / "rig.csv").write_text("time,voltage,position\n" + text(",", False, t_s, u_V, x_um))
    words = ["log", "import", str(tmp_path / "rig.csv")]
    seen = CliRunner().invoke(main, words)
    assert "nothing was written" in seen.stdout
    assert sorted(os.listdir(tmp_path)) == ["rig.csv"]
    words += ["-o", str(tmp_path / "out.h5")]
    made = CliRunner().invoke(main, [*words, "--json", "-"])
    assert made.exit_code == 0, made.stderr
    assert json.loads(made.stdout)["output"] == [str(tmp_path / "out.h5")]
    same(pl.read(tmp_path / "out.h5")[0])
    assert "exists already" in CliRunner().invoke(main, words).stderr


@pytest.mark.skipif(not DATA.is_dir(), reason="PHASELEAD_DATA names no folder of measured data")
def test_published_rigs_in_one_command_each():
    dbo = pl.import_recordings(DATA / "dbo/Model_Vi_Do.dat", rate="200Hz")
    assert [(one.name, one.column.number) for one in dbo.mapped] == [("u_V", 1), ("x_um", 5)]
    stage150 = pl.import_recordings(DATA / "stage150/hysteresis_v_150_1hz.csv")
    assert {one.name: one.column.number for one in stage150.mapped} == {"t_s": 2, "x_um": 3, "u_V": 4}
    files = [DATA / f"fsm/{name}_100mV_train.npy" for name in "uy"]
    fsm = pl.import_recordings(files, rate="6400Hz")
    assert len(fsm.recordings) == 6
    assert 1 < np.abs(fsm.recordings[0].x_um).max() < 10
