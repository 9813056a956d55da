"""The catalogue's page is the one its effects would write today."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from phaselead.model.effects import catalogue
from phaselead.report import catalogue_page as page

DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture(scope="module")
def files() -> dict[str, str]:
    return page.page()


def test_the_page_in_the_docs_is_not_stale(files, monkeypatch):
    monkeypatch.setattr(page, "page", lambda: files)
    assert page.stale(DOCS) == [], "run: python -m phaselead.report.catalogue_page"


def test_it_is_the_same_every_time(files):
    effect = catalogue()["creep"]
    assert page._picture(effect) == files["images/effects/creep.svg"]


def test_every_effect_has_its_section_and_its_figure(files):
    for name, effect in catalogue().items():
        assert f"\n## {effect.title}\n" in files["effects.md"]
        assert f"(images/effects/{name}.svg)" in files["effects.md"]
        assert all(f"| `{p.name}` | {p.unit} |" in files["effects.md"] for p in effect.parameters)
        assert ET.fromstring(files[f"images/effects/{name}.svg"]).tag.endswith("svg")


def test_what_is_stale_is_named(files, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(page, "page", lambda: files)
    assert page.main([str(tmp_path)]) == 0
    assert page.main([str(tmp_path), "--check"]) == 0
    creep = tmp_path / "images/effects/creep.svg"
    creep.write_text(creep.read_text("utf-8").replace("<path", "<line", 1), "utf-8")
    (tmp_path / "images/effects/gremlins.svg").write_text("<svg/>")
    text = (tmp_path / "effects.md").read_text("utf-8")
    (tmp_path / "effects.md").write_text(text.replace("0.015", "0.016"), "utf-8")
    assert page.main([str(tmp_path), "--check"]) == 1
    told = capsys.readouterr().err
    assert all(name in told for name in ("effects.md", "creep.svg", "gremlins.svg"))
    assert told.count("is stale") == 3


def test_a_coordinate_may_differ_by_a_hair_and_no_more():
    assert page._alike("L 10.1 20.3", "L 10.1 20.3")
    assert not page._alike("L 10.1 20.3", "L 10.1 20.6")
    assert not page._alike("L 10.1 20.3", "M 10.1 20.3")
