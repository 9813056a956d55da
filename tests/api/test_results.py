"""Results are for people: every one prints, shows itself as HTML, draws itself and becomes a data frame."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import phaselead as pl
from phaselead.result import Facts, Table
from phaselead.serial_ports import Ports


@pytest.fixture(scope="module")
def device_results(fitted: pl.FitResult) -> dict[str, Any]:
    with pl.connect() as dev:
        found: dict[str, Any] = {"info": dev.info(), "status": dev.status(), "upload": dev.upload(fitted)}
        found["closed"] = dev.track("sine:40um@5Hz", mode="inverse", duration=0.4)
        found["open"] = dev.track(x="sine:2V@5Hz", y="sine:2V@5Hz", mode="open", duration=0.4)
        found["listened"] = dev.record(duration=0.1)
        found["replay"] = pl.replay(found["closed"])
    with pl.connect() as dev:
        found["selftest"] = dev.selftest("xy")
    return found


@pytest.fixture(scope="module")
def results(records: pl.Recordings, fitted: pl.FitResult, device_results: dict[str, Any]) -> dict[str, Any]:
    return device_results | {
        "recording": records[0],
        "recordings": records,
        "none": pl.Recordings(),
        "fit": fitted,
        "linear": pl.fit(records[0], base="linear"),
        "stage": fitted.model,
        "verify": pl.verify(fitted, records),
        "nothing verified": pl.Verifications(),
        "voltage alone": pl.recording(t_s=[0, 0.1, 0.2], u_V=[0, 1, 2]),
        "ports": Ports(),
        "facts": Facts({"a<b": 1}),
    }


NAMES = [
    "info", "status", "upload", "closed", "open", "listened", "replay", "selftest", "recording", "recordings", "none",
    "fit", "linear", "stage", "verify", "nothing verified", "voltage alone", "ports", "facts",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_it_shows_itself(results: dict[str, Any], name: str) -> None:
    assert sorted(NAMES) == sorted(results)
    result = results[name]
    assert isinstance(str(result), str)
    assert "\n" not in repr(result)
    assert result._repr_html_().startswith("<")
    assert list(result.to_pandas().columns) == list(result.columns)
    if hasattr(result, "plot"):
        assert result.plot()._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", ["closed", "open", "recording", "voltage alone"])
def test_columns_are_those_of_the_csv(results: dict[str, Any], name: str, tmp_path: Path) -> None:
    pl.export(results[name], tmp_path / "out.csv")
    header = (tmp_path / "out.csv").read_text().splitlines()[0].split(",")
    frame = results[name].to_pandas()
    assert list(frame.columns) == header
    again = pl.read(tmp_path / "out.csv")[0]
    for column in header:
        assert np.array_equal(frame[column], again.columns[column])
        assert np.array_equal(getattr(results[name], column), again.columns[column])


def test_a_column_that_is_not_there(records: pl.Recordings) -> None:
    assert not hasattr(records[0], "r_um")
    with pytest.raises(AttributeError, match="there is no column y_um; there are t_s, u_V, x_um"):
        _ = records[0].y_um


def test_without_pandas(records: pl.Recordings, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(
        pl.PhaseleadError, match=r"^to_pandas needs pandas, which is not installed; pip install pandas$"
    ):
        records.to_pandas()


def test_a_run_is_saved_so_that_it_replays(results: dict[str, Any], tmp_path: Path) -> None:
    results["closed"].save(tmp_path / "run.h5")
    assert pl.replay(tmp_path / "run.h5")
    with pytest.raises(pl.BadInput, match="exists"):
        results["closed"].save(tmp_path / "run.h5", overwrite=False)


def test_nothing_is_written_over_unless_asked_for(
    results: dict[str, Any], fitted: pl.FitResult, tmp_path: Path
) -> None:
    """Every save wrote over what was there, while the commands and pl.export refuse."""
    mine = tmp_path / "mine.h5"
    mine.write_text("mine")
    for write in (results["closed"].save, fitted.save, fitted.model.save, partial(pl.write_report, fitted)):
        with pytest.raises(pl.BadInput, match="exists already") as refused:
            write(mine)
        assert "overwrite=True" in str(refused.value)
    assert mine.read_text() == "mine"
    fitted.save(mine, overwrite=True)
    assert pl.load(mine) == fitted.model


def test_a_model_is_taken_however_it_is_given(fitted: pl.FitResult, records: pl.Recordings, tmp_path: Path) -> None:
    fitted.save(tmp_path / "stage.toml")
    given = (fitted, fitted.model, tmp_path / "stage.toml", str(tmp_path / "stage.toml"))
    assert len({str(pl.verify(model, records[2]).columns) for model in given}) == 1


@pytest.mark.parametrize(
    "call",
    [
        lambda: pl.verify(3, []), lambda: pl.fit(3), lambda: pl.fit([3]), lambda: pl.read("*.no"),
        lambda: pl.read("a.csv", map=3), lambda: pl.read("a.csv", map={"u_V": "drive"}),
        lambda: pl.read("a.csv", map={"u_V": (1, "a")}), lambda: pl.read("a.csv", map={"u_V": (1,)}),
    ],
)  # fmt: skip
def test_what_is_no_model_or_record_is_refused(call: Callable[[], Any]) -> None:
    with pytest.raises(pl.BadInput):
        call()


@pytest.mark.parametrize(
    "columns",
    [
        {"t_s": [0, 1], "u_V": [0]},
        {"t_s": [0, 1, 3], "u_V": [0, 1, 2]},
        {"t_s": [0, 1], "u_V": [0, float("nan")]},
        {"t_s": [0, 1], "v": [0, 1]},
        {"u_V": [0, 1]},
        {"t_s": [0, 1]},
        {"t_s": "a", "u_V": "b", "x_um": "c"},
        {"t_s": [0, 1, 2], "u_V": ["a", 1, 1]},
        {"t_s": [0, 1, 2], "u_V": [1j, 1, 1]},
        {"t_s": [0, 1, 2], "u_V": np.array([1j, 1, 1])},
        {"t_s": [0, 1, 2], "u_V": [[1], 1, 1]},
        {"t_s": [0, 1, 2], "u_V": {"a": 1}},
    ],
)
def test_arrays_that_are_no_recording_are_refused(columns: dict[str, Any]) -> None:
    with pytest.raises(pl.BadInput):
        pl.recording(**columns)


def test_arguments_that_are_none_of_the_choices_are_refused(records: pl.Recordings, tmp_path: Path) -> None:
    """They raised a KeyError, an AttributeError or a TypeError, or were taken for one of them without a word."""
    stage: Any = "sim://xyz250"
    rate: Any = [200]
    anything: Any = "no"
    calls: list[tuple[Callable[[], Any], str]] = [
        (lambda: pl.gap(pl.load(stage), train=records[:1], holdout=records[1:], frozen=anything), "frozen='no'"),
        (lambda: pl.gap_next(3, output=tmp_path / "more.h5"), "a int proposes no experiment"),  # type: ignore[arg-type]
        (lambda: pl.verify(pl.load(stage), records, view=anything), "view='no'"),
        (lambda: pl.fit(records, base=anything), "base='no'"),
        (lambda: pl.plot(records, of=anything), "of='no'"),
        (lambda: pl.write_report(anything, tmp_path / "page.html"), "a str has no page; give the result itself"),
        (lambda: pl.read(tmp_path / "rig.csv", map="u_V=1", rate=rate), "no sampling rate"),
    ]
    (tmp_path / "rig.csv").write_text("0\n1\n")
    for call, said in calls:
        with pytest.raises(pl.BadInput, match=said):
            call()
    assert [path.name for path in tmp_path.iterdir()] == ["rig.csv"]


cells = st.text(st.characters(blacklist_categories=["Cc", "Cs", "Zl", "Zp"]), max_size=8)


def rows_of(columns: int) -> st.SearchStrategy[tuple[list[str], list[list[str]]]]:
    row = st.lists(cells, min_size=columns, max_size=columns)
    return st.tuples(row, st.lists(row))


@given(st.integers(1, 4).flatmap(rows_of))
def test_a_table_has_a_line_for_each_row(drawn: tuple[list[str], list[list[str]]]) -> None:
    """Whatever the cells hold: every row is a line, and markup in a cell stays text."""
    headings, rows = drawn
    table = Table(tuple(headings), tuple(map(tuple, rows)))
    assert str(table).count("\n") == max(len(rows) + any(headings) - 1, 0)
    assert table.html().count("<td") == len(rows) * len(headings)
    if any("<" in cell for row in rows for cell in row):
        assert "&lt;" in table.html()


def test_what_was_read_one_by_one_is_taken_as_what_was_read_at_once(records: pl.Recordings) -> None:
    one_by_one = [pl.read(record) for record in records]
    assert pl.read(one_by_one) == records
    assert pl.read([records, records[0]]) == [*records, records[0]]
