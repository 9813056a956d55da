"""What is written is read back bit for bit, whole, or not at all."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow.parquet
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.errors import BadInput
from phaselead.record import Recording, export, read_hdf5, read_recording, write_csv, write_hdf5
from phaselead.record.atomic import atomic_path, write_text
from phaselead.record.deferred import DeferredErrors

from recordings import assert_same, recordings, sine_recording  # isort: skip


@settings(max_examples=60, deadline=None)
@given(recordings())
def test_csv_round_trip(tmp_path_factory: pytest.TempPathFactory, recording: Recording) -> None:
    path = tmp_path_factory.mktemp("csv") / "rec.csv"
    write_csv(path, recording)
    assert_same(read_recording(path), recording)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
names = st.text("abcdefghij_", min_size=1, max_size=6)
arrays = st.sampled_from(["<u2", "<i4", "<i8", "<f8"]).flatmap(
    lambda kind: st.lists(st.integers(0, 60000), max_size=5).map(lambda values: np.array(values, dtype=kind))
)
leaves = arrays | st.binary(max_size=20) | st.lists(st.binary(max_size=5), max_size=4)
leaves |= json_values.filter(lambda value: not isinstance(value, dict))  # a dict is a group
trees = st.dictionaries(names, leaves | st.dictionaries(names, leaves, max_size=3), max_size=4)


def same(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same(a[name], b[name]) for name in a)
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    return bool(a == b) and isinstance(b, type(a))


@settings(max_examples=40, deadline=None)
@given(recordings(), st.dictionaries(names, json_values, max_size=3), trees, trees)
def test_hdf5_round_trip(
    tmp_path_factory: pytest.TempPathFactory,
    recording: Recording,
    meta: dict[str, Any],
    device: dict[str, Any],
    replay: dict[str, Any],
) -> None:
    path = tmp_path_factory.mktemp("h5") / "rec.h5"
    write_hdf5(path, replace(recording, meta=meta), device, replay)
    back = read_hdf5(path)
    assert_same(back.recording, recording)
    assert same(back.recording.meta, meta)
    assert same(back.device, device)
    assert same(back.replay, replay)
    assert_same(read_recording(path), recording)


def test_hdf5_reads_in_other_programs(tmp_path: Path) -> None:
    path = tmp_path / "rec.h5"
    write_hdf5(path, replace(sine_recording(), meta={"stage_file": "x" * 300_000}))
    with h5py.File(path) as file:
        assert sorted(file) == ["t_s", "u_V", "x_um"]
        assert file.attrs["format"] == "phaselead-recording"
        assert file.attrs["rate_Hz"] == pytest.approx(1000)
        assert file.attrs["axis"] == "x"
        assert {name: data.attrs["units"] for name, data in file.items()} == {"t_s": "s", "u_V": "V", "x_um": "um"}
        assert all(data.dtype == np.float64 and data.ndim == 1 for data in file.values())
    assert read_recording(path).meta["stage_file"] == "x" * 300_000


def test_hdf5_without_device_or_replay(tmp_path: Path) -> None:
    write_hdf5(tmp_path / "rec.h5", sine_recording())
    assert read_hdf5(tmp_path / "rec.h5").device is None
    assert read_hdf5(tmp_path / "rec.h5").replay is None


def spoil(path: Path, kind: str) -> None:
    if kind == "cut":
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        return
    with h5py.File(path, "a") as file:
        if kind == "foreign":
            del file.attrs["format"], file["t_s"]
        elif kind == "no time":
            del file["t_s"]
        elif kind == "newer":
            file.attrs["version"] = 99
        elif kind == "units":
            file["x_um"].attrs["units"] = "m"
        elif kind == "nan":
            file["x_um"][7] = np.nan
        elif kind == "text":
            del file["x_um"]
            file["x_um"] = "hello"
        elif kind == "length":
            del file["x_um"]
            file["x_um"] = np.zeros(3)
        elif kind == "uneven":
            file["t_s"][20] += 2e-4
        elif kind == "rate":
            file.attrs["rate_Hz"] *= 1.02
        elif kind == "no rate":
            file.attrs["rate_Hz"] = np.nan


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        ("cut", "is cut off after"),
        ("foreign", "no dataset t_s"),
        ("no time", "no dataset t_s"),
        ("newer", "newer phaselead"),
        ("units", "x_um has units 'm', expected um"),
        ("nan", "row 8: x_um"),
        ("text", "x_um is no one-dimensional dataset"),
        ("length", "differ in length (3..500)"),
        ("uneven", "row 21: t_s is not uniform"),
        ("rate", "states rate_Hz = 1020, but its times t_s have 1000 rows per second"),
        ("no rate", "states rate_Hz = nan"),
    ],
)
def test_hdf5_refuses_in_one_line(tmp_path: Path, kind: str, told: str) -> None:
    path = tmp_path / "rec.h5"
    write_hdf5(path, sine_recording())
    spoil(path, kind)
    with pytest.raises(BadInput) as refusal:
        read_recording(path)
    assert told in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_hdf5_tells_a_flipped_bit(tmp_path: Path) -> None:
    path = tmp_path / "rec.h5"
    write_hdf5(path, sine_recording())
    with h5py.File(path) as file:
        chunk = file["x_um"].id.get_chunk_info(0)
    content = bytearray(path.read_bytes())
    content[chunk.byte_offset + chunk.size // 2] ^= 4
    path.write_bytes(content)
    with pytest.raises(BadInput, match="HDF5"):
        read_recording(path)


@pytest.mark.parametrize("where", ["meta", "replay", "device"])
def test_gaps_are_seen_wherever_the_file_tells_of_them(tmp_path: Path, where: str) -> None:
    """A recording is read without most of its device and replay parts."""
    recording, ticks, gaps = sine_recording(6), np.array([0, 1, 2, 6, 7, 8]), [[3, 3]]
    recording = replace(recording, t_s=ticks / 1000, meta={"gaps": gaps} if where == "meta" else {})
    device = {"tick": ticks, "adc": {"x": ticks}} if where == "device" else None
    write_hdf5(tmp_path / "a.h5", recording, device, {"gaps": gaps} if where == "replay" else None)
    assert np.array_equal(read_recording(tmp_path / "a.h5").meta["gaps"], gaps)
    assert np.array_equal(read_hdf5(tmp_path / "a.h5").recording.meta["gaps"], gaps)


def test_hdf5_takes_no_map(tmp_path: Path) -> None:
    write_hdf5(tmp_path / "rec.h5", sine_recording())
    with pytest.raises(BadInput, match="--map"):
        read_recording(tmp_path / "rec.h5", rate_Hz=5.0)


def test_export_writes_what_the_suffix_says(tmp_path: Path) -> None:
    recording = sine_recording()
    for suffix in ("csv", "h5", "mat", "parquet"):
        export(recording, tmp_path / f"rec.{suffix}")
    assert_same(read_recording(tmp_path / "rec.csv"), recording)
    assert_same(read_recording(tmp_path / "rec.h5"), recording)
    mat = scipy.io.loadmat(tmp_path / "rec.mat")
    np.testing.assert_array_equal(mat["x_um"][:, 0], recording.axes["x"].x_um)
    parquet = pyarrow.parquet.read_table(tmp_path / "rec.parquet")
    assert parquet.column_names == ["t_s", "u_V", "x_um"]
    assert parquet.schema.field("x_um").metadata[b"units"] == b"um"
    np.testing.assert_array_equal(parquet["u_V"].to_numpy(), recording.axes["x"].u_V)


@pytest.mark.parametrize("suffix", ["csv", "h5", "mat", "parquet"])
def test_export_writes_over_nothing_unless_told(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"rec.{suffix}"
    path.write_text("mine")
    with pytest.raises(BadInput, match="exists already"):
        export(sine_recording(), path)
    assert path.read_text() == "mine"
    export(sine_recording(), path, overwrite=True)
    assert path.read_bytes() != b"mine"
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("name", ["rec", "rec.txt", "rec.npy"])
def test_export_refuses_other_suffixes(tmp_path: Path, name: str) -> None:
    with pytest.raises(BadInput, match=r"use \.csv, \.h5, \.mat or \.parquet"):
        export(sine_recording(), tmp_path / name)
    assert not os.listdir(tmp_path)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "rec.h5"
    write_hdf5(path, sine_recording())
    before = path.read_bytes()
    with pytest.raises(TypeError):
        write_hdf5(path, sine_recording(), replay={"a": {"b": object()}})
    assert path.read_bytes() == before
    with suppress(ZeroDivisionError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["rec.h5"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_at_any_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number) -> None:
    """HDF5 swallowed one that came while it wrote: the file had its name, and rows of zeros."""
    path, writes, moments = tmp_path / "rec.h5", count(), [-1]
    write, before = DeferredErrors.write, signal.getsignal(number)

    def watched(through: DeferredErrors, data: Any) -> int:
        if next(writes) == moments[0]:
            signal.raise_signal(number)
        return write(through, data)

    monkeypatch.setattr(DeferredErrors, "write", watched)
    signal.signal(number, signal.default_int_handler)
    try:
        write_hdf5(path, sine_recording())
        kept = path.read_bytes()
        for moment in range(next(writes)):
            writes, moments[0] = count(), moment
            with pytest.raises(KeyboardInterrupt):
                write_hdf5(path, sine_recording())
            assert path.read_bytes() == kept
            assert os.listdir(tmp_path) == ["rec.h5"]
    finally:
        signal.signal(number, before)


def test_nothing_appears_before_it_is_whole(tmp_path: Path) -> None:
    with atomic_path(tmp_path / "a") as temporary:
        temporary.write_text("half")
        assert not (tmp_path / "a").exists()
    assert (tmp_path / "a").read_text() == "half"


def test_who_reads_the_old_file_goes_on_reading_it(tmp_path: Path) -> None:
    write_text(tmp_path / "a", "old")
    with open(tmp_path / "a") as reader:
        write_text(tmp_path / "a", "new and longer")
        assert reader.read() == "old"
    assert (tmp_path / "a").read_text() == "new and longer"


def test_a_link_is_written_through(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_a_missing_directory_is_told(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"cannot be written.*No such file"):
        write_text(tmp_path / "none" / "a", "text")
    with pytest.raises(BadInput, match="is a directory"):
        write_text(tmp_path, "text")
