"""The manual's table of waveforms is the one that the kinds would write today."""

from __future__ import annotations

from pathlib import Path

from phaselead.report import waveform_table as table
from phaselead.waveforms.catalogue import kinds, parse_wave

DOCS = Path(__file__).parents[2] / "docs"


def test_the_table_in_the_docs_is_not_stale():
    assert table.main([str(DOCS), "--check"]) == 0, "run: python -m phaselead.report.waveform_table"


def test_every_way_to_write_a_kind_is_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "path.csv").write_text("0\n1\n")
    (tmp_path / "scan.csv").write_text("t_s,x_um\n0,0\n0.05,1\n")
    for name, kind in kinds().items():
        assert all(isinstance(parse_wave(how), kind) for how, _ in kind.written)
        assert all(f"| `{how}` | {what} |\n" in table.table() for how, what in kind.written)
        assert kind.kind == name


def test_what_is_stale_is_named_and_mended(tmp_path, capsys):
    text = (DOCS / table.PAGE).read_text("utf-8")
    page = tmp_path / table.PAGE
    page.write_text(text.replace("triangle between 0 and 100 um", "square"), "utf-8")
    assert table.main([str(tmp_path), "--check"]) == 1
    assert "is stale" in capsys.readouterr().err
    assert table.main([str(tmp_path)]) == 0
    assert page.read_text("utf-8") == text
