"""Recordings from text: what is read, and the one line that refuses the rest."""

from __future__ import annotations

import os
import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from phaselead.errors import BadInput
from phaselead.record import parse_column_map, parse_rate, read_recording, refuse_map_of_some

GOOD = "t_s,u_V,x_um\n0,1,10\n0.1,2,20\n0.2,3,30\n0.3,4,40\n"


def write(tmp_path: Path, text: str | bytes, name: str = "rec.csv") -> str:
    path = tmp_path / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return str(path)


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        "\ufeff" + GOOD,
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD.replace(",", "   "),
        GOOD.replace(",", " , "),
        GOOD.rstrip("\n"),
        "# made by hand\n\n" + GOOD.replace("0.2,3", "% pause\n\n0.2,3"),
        "# " + GOOD,
        '"t_s","u_V","x_um"\n' + GOOD.split("\n", 1)[1],
        GOOD.replace("\n", ",\n").replace("x_um,", "x_um"),
        GOOD.replace("x_um", "x_um,note").replace("10\n", "10,a\n").replace("20\n", "20,\n")
        .replace("30\n", "30,c\n").replace("40\n", "40,d\n"),
    ],
)  # fmt: skip
def test_reads_the_same_from_every_dialect(tmp_path: Path, text: str) -> None:
    recording = read_recording(write(tmp_path, text))
    np.testing.assert_array_equal(recording.t_s, [0, 0.1, 0.2, 0.3])
    np.testing.assert_array_equal(recording.axes["x"].u_V, [1, 2, 3, 4])
    np.testing.assert_array_equal(recording.axes["x"].x_um, [10, 20, 30, 40])
    assert recording.axes["x"].r_um is None
    assert recording.from_rest


@pytest.mark.parametrize(
    ("header", "axes"),
    [
        ("t_s,u_V", {"x": "u"}),
        ("t_s,x_um", {"x": "x"}),
        ("t_s,u_V,x_um,r_um", {"x": "uxr"}),
        ("t_s,uy_V,y_um", {"y": "ux"}),
        ("t_s,u_V,y_um", {"y": "ux"}),
        ("t_s,ux_V,uy_V,uz_V,x_um,y_um,z_um", {"x": "ux", "y": "ux", "z": "ux"}),
        ("t_s,ux_V,uy_V,x_um,y_um,rx_um,ry_um", {"x": "uxr", "y": "uxr"}),
        ("t_s,ux_V,x_um,y_um", {"x": "ux", "y": "x"}),
    ],
)
def test_header_gives_the_axes(tmp_path: Path, header: str, axes: dict[str, str]) -> None:
    width = header.count(",")
    rows = "".join(f"{t}{',1.5' * width}\n" for t in range(3))
    recording = read_recording(write(tmp_path, f"{header}\n{rows}"))
    found = {
        name: "".join(
            letter for letter, field in (("u", "u_V"), ("x", "x_um"), ("r", "r_um")) if getattr(axis, field) is not None
        )
        for name, axis in recording.axes.items()
    }
    assert found == axes


def test_columns_are_mapped_scaled_and_timed(tmp_path: Path) -> None:
    text = "Rig 7\nchannel A\tchannel B\n\t1\t\t0.000010\n\t2\t\t0.000020\n\t3\tx\t0.000030\n"
    recording = read_recording(
        write(tmp_path, text), columns=parse_column_map("u_V=2, x_um=4*1e6"), rate_Hz=parse_rate("200Hz")
    )
    np.testing.assert_array_equal(recording.axes["x"].u_V, [1, 2, 3])
    np.testing.assert_allclose(recording.axes["x"].x_um, [10, 20, 30], rtol=1e-15)
    np.testing.assert_array_equal(recording.t_s, [0, 0.005, 0.01])


def test_map_reads_a_file_whose_header_has_other_units(tmp_path: Path) -> None:
    path = write(tmp_path, "t_ms,u_mV,x_nm\n0,1000,10\n100,2000,20\n200,3000,30\n")
    with pytest.raises(BadInput) as refusal:
        read_recording(path)
    text = str(refusal.value)
    assert "column 1 is 't_ms', expected t_s (seconds)" in text
    proposed = text.rsplit("--map ", 1)[1]
    recording = read_recording(path, columns=parse_column_map(proposed))
    np.testing.assert_allclose(recording.t_s, [0, 0.1, 0.2])
    np.testing.assert_allclose(recording.axes["x"].u_V, [1, 2, 3])
    np.testing.assert_allclose(recording.axes["x"].x_um, [0.01, 0.02, 0.03])


def test_rounded_times_are_uniform_within_a_percent(tmp_path: Path) -> None:
    times = [f"{n / 6400:.6f}" for n in range(1000)]
    recording = read_recording(write(tmp_path, "t_s,u_V\n" + "".join(f"{t},1\n" for t in times)))
    assert recording.rate_Hz == pytest.approx(6400, rel=1e-4)


def test_rate_replaces_times_that_are_only_rounded(tmp_path: Path) -> None:
    path = write(tmp_path, "t_s,u_V\n" + "".join(f"{2 + n / 5000:.3f},1\n" for n in range(1000)))
    with pytest.raises(BadInput, match="--rate"):
        read_recording(path)
    recording = read_recording(path, rate_Hz=5000)
    np.testing.assert_allclose(recording.t_s, 2 + np.arange(1000) / 5000)


@pytest.mark.parametrize(
    ("window", "first", "stop", "last"),
    [("5:7", 5, 7, 6.9), ("5:", 5, None, 9.9), (":7", 0, 7, 6.9), (":", 0, None, 9.9), ("4.95:5.25", 5, 5.25, 5.2)],
)
def test_window_keeps_what_warms_the_memory(
    tmp_path: Path, window: str, first: float, stop: float | None, last: float
) -> None:
    path = write(tmp_path, "t_s,u_V,x_um\n" + "".join(f"{n / 10},{n},{n}\n" for n in range(100)))
    recording = read_recording(f"{path}@{window}")
    assert recording.t_s[0] == 0
    assert recording.t_s[-1] == pytest.approx(last)
    scored = recording.t_s[recording.scored]
    assert scored[0] == pytest.approx(first)
    assert scored[-1] == recording.t_s[-1]
    assert recording.from_rest == (first == 0)
    assert len(recording.axes["x"].x_um) == len(recording.t_s)


def test_window_edges_forgive_printed_times(tmp_path: Path) -> None:
    rows = "".join(f"{t},1\n" for t in ("0", "0.99999999", "2.00000001", "2.99999999", "4"))
    recording = read_recording(write(tmp_path, "t_s,u_V\n" + rows) + "@1:3")
    np.testing.assert_allclose(recording.t_s[recording.scored], [1, 2], atol=1e-7)


def test_path_may_contain_an_at_sign(tmp_path: Path) -> None:
    path = write(tmp_path, GOOD, "rec@0.csv")
    assert read_recording(path).from_rest
    assert read_recording(f"{path}@0.1:0.3").scored == slice(1, 3)
    whole = write(tmp_path, GOOD, "rec@1:2")
    assert len(read_recording(whole).t_s) == 4


def line_of(refusal: pytest.ExceptionInfo[BadInput]) -> str:
    text = str(refusal.value)
    assert "\n" not in text
    assert len(text) < 500
    return text


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", ["is empty", "t_s,u_V,x_um"]),
        (" \n\n", ["is empty"]),
        ("t_s,u_V,x_um\n", ["no rows"]),
        ("t_s,u_V,x_um\n0,1,2\n", ["1 row of data", "at least 2"]),
        ("0,1,2\n1,2,3\n", ["first line", "'0,1,2'", "--map u_V=1,x_um=2 --rate 200Hz"]),
        ("foo,bar\n1,2\n", ["first line", "'foo,bar'", "--map"]),
        (GOOD.replace("u_V", "u_mV"), ["column 2", "'u_mV'", "expected u_V (volts)", "u_V=2*0.001"]),
        (GOOD.replace("x_um", "x_m"), ["column 3", "'x_m'", "expected x_um (micrometres)", "x_um=3*1e+06"]),
        (GOOD.replace("t_s", "t_ms"), ["column 1", "'t_ms'", "expected t_s (seconds)", "t_s=1*0.001"]),
        (GOOD.replace("t_s", "time"), ["column 1", "'time'", "expected t_s"]),
        (GOOD.replace("u_V", "u_v"), ["'u_v'", "expected u_V"]),
        (GOOD.replace("u_V", "x_um"), ["x_um appears twice (2 and 3)"]),
        (GOOD.replace("t_s", "temperature"), ["has no time", "--rate"]),
        ("t_s,r_um\n0,1\n1,2\n", ["neither u_V nor x_um"]),
        ("t_s,u_V,x_um,y_um\n0,1,2,3\n1,2,3,4\n", ["u_V with several axes", "ux_V"]),
        ("t_s,u_V,ux_V\n0,1,2\n1,2,3\n", ["both u_V and ux_V"]),
        (GOOD.replace("20", "nan"), ["line 3", "x_um", "not a number"]),
        (GOOD.replace("20", "1e300"), ["line 3", "x_um is 1e+300", "measure again"]),
        (GOOD.replace("20", "-inf"), ["line 3", "x_um", "infinite"]),
        (GOOD.replace("20", "1e999"), ["line 3", "x_um", "infinite"]),
        (GOOD.replace("20", ""), ["line 3", "x_um", "empty"]),
        (GOOD.replace("20", "abc"), ["line 3", "x_um is 'abc'", "not a number"]),
        ("# note\n\n" + GOOD.replace("20", "nan"), ["line 5", "x_um"]),
        (GOOD.replace(",20", ""), ["line 3", "2 fields, 3 expected"]),
        (GOOD + "0.4,5", ["line 6", "2 fields, 3 expected"]),
        (GOOD.replace(",", ";").replace(".", ","), ["line 3", "'0,1'", "decimals take a point"]),
        (GOOD.replace("0.2,", "0.1,"), ["line 4", "t_s repeats (0.1 s after 0.1 s)"]),
        (GOOD.replace("0.2,", "0.05,"), ["line 4", "t_s goes back (0.05 s after 0.1 s)"]),
        (GOOD.replace("0.3,", "0.35,"), ["line 5", "0.15 s", "0.1 s elsewhere", "--rate 10Hz"]),
        (GOOD.replace("0.3,", "0.3011,"), ["line 5", "not uniform"]),
        (b"t_s,u_V\x00\n1,2\n", ["neither text nor HDF5"]),
        (GOOD.encode("utf-16"), ["neither text nor HDF5"]),
        (b"\x89HDF\r\n\x1a\nrubbish", ["no whole HDF5 file"]),
        (b"phaselead-journal 1 x", ["never finished", "log recover"]),
    ],
)
def test_refuses_in_one_line(tmp_path: Path, text: str | bytes, told: list[str]) -> None:
    path = write(tmp_path, text)
    with pytest.raises(BadInput) as refusal:
        read_recording(path)
    line = line_of(refusal)
    assert line.startswith(path)
    for part in told:
        assert part in line, line


@pytest.mark.parametrize(
    ("columns", "rate_Hz", "told"),
    [
        ({"u_V": (2, 1.0), "x_um": (9, 1.0)}, 10.0, ["has 3 columns", "x_um is mapped to column 9"]),
        ({"u_V": (2, 1.0)}, None, ["no time", "t_s=COLUMN", "--rate"]),
        ({"u_V": (2, 1.0)}, float("nan"), ["no sampling rate", "200Hz"]),
        ({"u_V": (2, 1.0), "t_s": (1, 1.0)}, 200.0, ["t_s says 10 Hz", "--rate says 200 Hz"]),
        ({}, 10.0, ["is empty", "--map"]),
        ({"u_V": (0, 1.0)}, 10.0, ["count from 1"]),
        ({"u_V": (1, float("inf"))}, 10.0, ["factor"]),
        ({"u_V": (1, 1.0), "x_um": (1, 1.0)}, 10.0, ["column 1 is both u_V and x_um"]),
    ],
)
def test_refuses_a_map_that_does_not_fit(
    tmp_path: Path, columns: dict[str, tuple[int, float]], rate_Hz: float | None, told: list[str]
) -> None:
    path = write(tmp_path, GOOD)
    with pytest.raises(BadInput) as refusal:
        read_recording(path, columns=columns, rate_Hz=rate_Hz)
    for part in told:
        assert part in line_of(refusal)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "NAME=COLUMN"),
        ("u_V", "NAME=COLUMN"),
        ("u_V=a", "NAME=COLUMN"),
        ("u_V=1*a", "no number"),
        ("u_V=0", "count from 1"),
        ("u_V=1,u_V=2", "given twice"),
        ("u_mV=1", "write u_V=COLUMN*0.001"),
        ("x_mm=1", "write x_um=COLUMN*1000"),
        ("ux_W=1", "write ux_V=COLUMN"),
        ("foo=1", "one of t_s, u_V"),
        ("u_V=1*0", "not 0"),
        ("u_V=1*nan", "finite"),
    ],
)
def test_refuses_a_malformed_map(text: str, told: str) -> None:
    with pytest.raises(BadInput) as refusal:
        parse_column_map(text)
    assert told in line_of(refusal)


@pytest.mark.parametrize(("text", "rate"), [("200Hz", 200), ("200", 200), ("5kHz", 5000), ("6.4e3 Hz", 6400)])
def test_reads_rates(text: str, rate: float) -> None:
    assert parse_rate(text) == rate


@pytest.mark.parametrize("text", ["", "Hz", "0Hz", "-5", "nan", "inf", "5s", "5 MHz"])
def test_refuses_rates(text: str) -> None:
    with pytest.raises(BadInput, match="200Hz"):
        parse_rate(text)


@pytest.mark.parametrize(
    ("window", "told"),
    [
        ("5", "@5:7"),
        ("a:b", "@5:7"),
        ("1:nan", "@5:7"),
        ("1:2:3", "@5:7"),
        ("0.3:0.1", "window is empty"),
        ("7:9", "from 0 to 0.3 s"),
        ("0.1:0.15", "1 rows lie in the window"),
    ],
)
def test_refuses_windows(tmp_path: Path, window: str, told: str) -> None:
    path = write(tmp_path, GOOD)
    with pytest.raises(BadInput) as refusal:
        read_recording(f"{path}@{window}")
    assert told in line_of(refusal)


@pytest.mark.parametrize("name", ["missing.csv", "missing.csv@1:2", "", "a\0b", "."])
def test_refuses_what_is_no_file(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput) as refusal:
        read_recording(name)
    assert "give a recording" in line_of(refusal)


DATA = Path(os.environ.get("PHASELEAD_DATA", "/nowhere"))


@pytest.mark.skipif(not (DATA / "dbo").is_dir(), reason="PHASELEAD_DATA does not hold the measured records")
def test_reads_measured_records() -> None:
    dbo = read_recording(DATA / "dbo/Model_Vi_Do.dat", columns={"u_V": (1, 1.0), "x_um": (5, 1.0)}, rate_Hz=200.0)
    assert len(dbo.t_s) == 8027
    stage150 = read_recording(
        f"{DATA}/stage150/hysteresis_v_150_1hz.csv@5:7",
        columns={"t_s": (2, 1.0), "x_um": (3, 1.0), "u_V": (4, 1.0)},
    )
    assert stage150.scored == slice(25000, 35000)
    assert stage150.rate_Hz == pytest.approx(5000, rel=1e-6)


@pytest.mark.parametrize(("rows", "said"), [("", "has no rows of data"), ("0,1,10\n", "has 1 row of data")])
def test_too_few_rows_are_refused_with_what_to_do(tmp_path: Path, rows: str, said: str) -> None:
    with pytest.raises(BadInput, match=rf"rec\.csv: {said}, at least 2 are needed; record for longer, or give"):
        read_recording(write(tmp_path, "t_s,u_V,x_um\n" + rows))


def test_one_map_is_for_files_that_are_alike(tmp_path: Path) -> None:
    ours, theirs = write(tmp_path, "t_s,u_V,x_um\n0,1,2\n1,2,3\n"), write(tmp_path, "time ms, drive\n0,1\n", "b.csv")
    timeless, channels = write(tmp_path, "u_V,x_um\n1,2\n", "c.csv"), write(tmp_path, "t_s,Ch1,Ch2\n0,1,2\n", "d.csv")
    columns = {"t_s": (1, 1.0), "u_V": (2, 1e-3), "x_um": (3, 1e-3)}
    for named in (f"{ours}@0:1", timeless):
        with pytest.raises(
            BadInput, match=re.escape(f"{named.split('@')[0]}: names its columns in V and um, {theirs}")
        ):
            refuse_map_of_some([named, theirs], columns)
    with h5py.File(tmp_path / "c.h5", "w"), pytest.raises(BadInput, match=r"c\.h5: names its columns"):
        refuse_map_of_some([str(tmp_path / "c.h5"), theirs], columns)
    empty = write(tmp_path, "", "empty.csv")
    for some in ([ours, ours], [theirs, channels], [ours, "missing.csv"], [ours, empty], [ours, timeless]):
        refuse_map_of_some(some, columns)
    refuse_map_of_some([ours, theirs], None)
    refuse_map_of_some([ours, theirs], {"t_s": (1, 1.0), "u_V": (2, 1.0), "x_um": (3, 1.0)})
