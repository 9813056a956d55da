"""Whatever bytes a recording is made of: it is read, or refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from phaselead.errors import BadInput
from phaselead.record import parse_column_map, read_recording, write_csv, write_hdf5
from phaselead.record.read import split_argument

from recordings import assert_one_line, sine_recording  # isort: skip


@pytest.fixture(scope="module")
def seeds(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("seeds")
    recording = sine_recording(n=20)
    write_csv(folder / "rec.csv", recording)
    write_hdf5(folder / "rec.h5", recording, {"tick": recording.t_s.astype(int)}, {"frames": [b"abc", b""]})
    return {"csv": (folder / "rec.csv").read_bytes(), "h5": (folder / "rec.h5").read_bytes()}


def read_or_refuse(path: Path, content: bytes, columns: dict[str, tuple[int, float]] | None = None) -> None:
    path.write_bytes(content)
    try:
        recording = read_recording(path, columns=columns, rate_Hz=200.0 if columns else None)
    except BadInput as refusal:
        assert_one_line(refusal)
    else:
        assert len(recording.t_s) >= 2


text_like = st.lists(
    st.sampled_from(["t_s", "u_V", "x_um", "u_mV", ",", ";", "\t", " ", "\n", "\r", "#", '"', "'", "1", "0.1", "-2e3",
                     "nan", "1e999", "_", "é", "x", "\0", "\ufeff", "1_0", "0x1"])
).map("".join)  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(content=st.binary(max_size=300) | text_like.map(str.encode), mapped=st.booleans(), headed=st.booleans())
@example(content=b'"', mapped=False, headed=True)
@example(content=b'0,1,"2\n0.1,2,3\n', mapped=False, headed=True)
def test_any_bytes(tmp_path_factory: pytest.TempPathFactory, content: bytes, mapped: bool, headed: bool) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.csv"
    columns = parse_column_map("u_V=1,x_um=2") if mapped else None
    read_or_refuse(path, b"t_s,u_V,x_um\n" + content if headed else content, columns)


mutations = st.lists(
    st.tuples(
        st.floats(0, 1), st.sampled_from(["flip", "cut", "insert", "repeat", "end"]), st.binary(min_size=1, max_size=4)
    ),
    min_size=1,
    max_size=4,
)


def mutate(content: bytes, steps: list[tuple[float, str, bytes]]) -> bytes:
    for where, what, data in steps:
        at = int(where * len(content))
        if what == "flip":
            content = content[:at] + data + content[at + len(data) :]
        elif what == "cut":
            content = content[:at] + content[at + data[0] :]
        elif what == "insert":
            content = content[:at] + data + content[at:]
        elif what == "repeat":
            content = content[:at] + content[at : at + data[0]] + content[at:]
        else:
            content = content[:at]
    return content


@settings(max_examples=200, deadline=None)
@given(steps=mutations)
def test_mutated_csv(
    tmp_path_factory: pytest.TempPathFactory, seeds: dict[str, bytes], steps: list[tuple[float, str, bytes]]
) -> None:
    read_or_refuse(tmp_path_factory.getbasetemp() / "fuzz.csv", mutate(seeds["csv"], steps))


@settings(max_examples=300, deadline=None)
@given(steps=mutations)
def test_mutated_hdf5(
    tmp_path_factory: pytest.TempPathFactory, seeds: dict[str, bytes], steps: list[tuple[float, str, bytes]]
) -> None:
    read_or_refuse(tmp_path_factory.getbasetemp() / "fuzz.h5", mutate(seeds["h5"], steps))


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=20) | st.from_regex(r"[a-z]?@[0-9.:eninf+-]*", fullmatch=True))
def test_any_argument(argument: str) -> None:
    try:
        split_argument(argument)
    except BadInput as refusal:
        assert_one_line(refusal)


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=20) | st.from_regex(r"([ux]_(V|um)=[0-9]*(\*[0-9.e]+)?,?)*", fullmatch=True))
def test_any_column_map(text: str) -> None:
    try:
        parse_column_map(text)
    except BadInput as refusal:
        assert_one_line(refusal)
