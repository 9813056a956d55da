"""Pages of results: what a card says, every command's page, and a look that suits light and dark."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from markupsafe import escape

import phaselead as pl
from phaselead.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, RED
from phaselead.gap import GapResult, NamedEffect, Trace
from phaselead.gap.findings import GapSize
from phaselead.model import AxisModel, Stage
from phaselead.record import Source
from phaselead.report import page as page_module
from phaselead.report.axis_figures import bode_figure, creep_figure, noise_figure, response_of, step_figure
from phaselead.report.campaign import ON_DARK, ON_LIGHT, confusion_figure
from phaselead.report.gap import cards, in_usual_unit, scaled_row, trace_figure, verdict_card
from phaselead.report.origin import Origin
from phaselead.report.page import COLOURS_OF_THE_PAGE, command_line, render
from phaselead.report.results import result_page
from phaselead.sim import built_in

LOWPASS = NamedEffect("amplifier_lowpass", {"tau_s": (5.03e-4, "s", (4.9e-4, 5.2e-4))}, 0.9)


@pytest.fixture(name="nothing", scope="module")
def _nothing() -> GapResult:
    return GapResult(
        stage=Stage(name="s", axes={"x": AxisModel()}), verdicts=("none",), effects=(), ties=(), excluded=(),
        untestable=(), where=(), gap=GapSize(0.3, 0.01, 0.015), next_experiment=None, holdout_sha256=(),
        candidates=(), traces=(), untestable_why={}, seconds=1.0, adopted=(), unexplained=None,
    )  # fmt: skip


def test_the_big_card_says_what_and_how_large(nothing):
    card = verdict_card(replace(nothing, verdicts=("named",), effects=(LOWPASS,)))
    assert card["value"] == "Amplifier low-pass"
    assert card["label"].startswith("0.503 ms, 316 Hz; verdict: named")
    assert verdict_card(nothing)["value"] == "Nothing was found"
    tie = verdict_card(replace(nothing, verdicts=("tie",), ties=(("delay", "amplifier_lowpass"),)))
    assert tie["value"] == "Delay or amplifier low-pass"
    assert verdict_card(replace(nothing, verdicts=("unknown",)))["value"] == "Something unnamed"


def test_a_gap_below_its_floor_is_explained(nothing):
    assert "no more than the floor" in cards(nothing)[2]["label"]
    assert "floor" not in cards(replace(nothing, gap=GapSize(0.3, 0.2, 0.015)))[2]["label"]


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [
        (5.03e-4, "s", "0.503 ms"),
        (2e-6, "s", "0.002 ms"),
        (2.0, "s", "2 s"),
        (0.03, "um", "30 nm"),
        (0.2, "1", "0.2"),
        (1e3, "Hz", "1000 Hz"),
    ],
)
def test_units_are_those_a_person_uses(value, unit, said):
    assert in_usual_unit(value, unit) == said


def test_parameters_and_their_intervals_are_in_one_unit():
    row = scaled_row("tau_s", 5.03e-4, 4.9e-4, 1.2, "s")
    assert (row["name"], row["unit"]) == ("tau", "ms")
    assert (row["value"], row["low"], row["high"]) == pytest.approx((0.503, 0.49, 1200))
    assert scaled_row("f_Hz 1", 200.0, 190.0, 210.0, "Hz")["name"] == "f 1"
    assert scaled_row("k", 0.01, 0.0, 0.02, "1") == {"name": "k", "value": 0.01, "low": 0.0, "high": 0.02, "unit": "1"}


def test_what_is_left_has_a_scale_of_its_own():
    t = np.arange(1000) / 1000
    x = np.sin(20 * t)
    figure = trace_figure(Trace("rec", "x", t, x, x, x + 1.0, x + 0.001 * np.cos(90 * t)))
    low, high = figure.axes[2].get_ylim()
    assert high - low < 0.01


@pytest.fixture(name="results", scope="module")
def _results() -> dict[str, object]:
    with pl.connect() as dev:
        fitted = dev.identify(levels=[1, 2, 3], frequencies=[10, 15, 20], creep=False)
        dev.upload(fitted)
        run = dev.track("sine:20um@12Hz", duration=0.5)
        other = dev.record("sine:2V@12Hz", duration=0.5)
    with pl.connect() as dev:
        driven = dev.track("sine:2V@12Hz", mode="open", duration=0.3)
    return {"fit": fitted, "run": run, "verify": pl.verify(fitted, other), "open": driven}


class Tags(HTMLParser):
    """Fails on tags that are closed in another order than they were opened."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "input", "link", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.mark.parametrize("name", ["fit", "run", "verify", "open"])
def test_every_result_has_a_page(results, tmp_path, name):
    pl.write_report(results[name], tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    tags = Tags()
    tags.feed(page)
    assert tags.open == []
    assert page.count("<svg") >= 1
    assert "<script" not in page
    assert "http" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)
    questions = re.findall(r"<h2>(.*?)</h2>", page)
    assert questions
    assert all(question.endswith("?") for question in questions)


@pytest.fixture(name="identified", scope="module")
def _identified() -> pl.FitResult:
    with pl.connect() as dev:
        return dev.identify("xyz", levels=[1, 2, 3], frequencies=[10, 15, 20])


def test_a_fit_shows_response_step_creep_and_noise_of_every_axis(identified):
    page = result_page(identified)
    for question in ("answer each frequency", "answer a step", "go on while it is held", "what is left is noise"):
        assert question in page
    for figure in (bode_figure, step_figure, creep_figure, noise_figure):
        labels = {text.get_text()[0] for text in figure(identified).axes[0].get_legend().get_texts()}
        assert labels == set("xyz"), figure


def test_the_figures_of_an_axis_are_those_of_its_stage(identified):
    """A mode where the stage has one, 10 nm of sensor noise, and the creep that was recorded."""
    f_Hz, response = response_of(built_in("xyz250").axis("x"))
    assert f_Hz[np.argmax(np.abs(response))] == pytest.approx(200, abs=2)
    slow = np.abs(response[f_Hz < 5])
    assert np.abs(np.diff(np.log(slow))).max() < 0.02
    floor, *_ = (one.get_ydata()[0] for one in noise_figure(identified).axes[0].lines if one.get_linestyle() == "--")
    assert floor == pytest.approx(10 * np.sqrt(2 / 5000), rel=0.1)
    lines = creep_figure(identified).axes[0].lines
    measured, model = (one.get_ydata() for one in lines if one.get_label().startswith("x"))
    assert model[-1] == pytest.approx(np.mean(measured[-50:]), rel=0.3)


def test_a_fit_without_creep_says_how_to_measure_it(results):
    assert creep_figure(results["fit"]) is None
    assert "phaselead identify</code> holds each axis" in result_page(results["fit"])


def test_figures_take_the_colours_of_the_page(results):
    page = result_page(results["run"])
    assert "prefers-color-scheme: dark" in page
    figures = "".join(re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL))
    assert "currentColor" in figures
    for colour in ("#000000", "#ffffff", "#e4e4e4"):
        assert colour not in figures, colour


def test_words_in_figures_are_words_and_the_same_result_is_the_same_page(results):
    """They were drawn as paths, with names that changed from page to page: nothing could be searched or copied."""
    page = result_page(results["run"])
    figures = "".join(re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL))
    assert re.search(r"<text[^>]*>position \(µm\)</text>", figures)
    assert result_page(results["run"]) == page


@pytest.mark.parametrize("colour", [BLUE, ORANGE, GREEN, RED, PURPLE, GREY])
def test_every_colour_of_a_figure_has_one_for_a_dark_page(colour):
    name = COLOURS_OF_THE_PAGE[colour]
    variable = re.fullmatch(r"var\((--\w+)\)", name)
    assert variable is not None
    page = render("result.html", title="t", lead=[], cards=[], parts=[])
    light, dark = re.findall(rf"{variable[1]}: (#[0-9a-f]{{6}});", page)
    assert light == colour
    assert brightness(dark) > 0.3


def brightness(colour: str) -> float:
    """Relative luminance (WCAG 2.2): on a ground of 0.01 one of 0.3 has a contrast above 5."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_every_command_writes_its_page(run, stage_file, tmp_path):
    record = tmp_path / "rec.h5"
    assert run("log", "record", "--drive", "sine:5V@5Hz", "--duration", 1, "-o", record).status == 0
    page = tmp_path / "page.html"
    for words in (
        ("track", "sine:20um@5Hz", "--model", stage_file, "--duration", 1),
        ("verify", "--model", stage_file, record),
        ("fit", record, "-o", tmp_path / "fit.toml"),
    ):
        outcome = run(*words, "--report", page)
        assert outcome.status == 0, outcome.err
        page.unlink()
    assert run("verify", "--model", stage_file, record, "--report", tmp_path / "no" / "x.html").status == 2


def test_words_of_figures_take_the_colour_of_the_page(results):
    """A figure's letters are outlines without a colour of their own: what they stand in gives it."""
    page = result_page(results["run"])
    rule = re.search(r"figure svg \{([^}]*)\}", page)
    assert rule is not None
    assert "fill: currentColor" in rule[1]
    assert "color: var(--ink)" in rule[1]


def test_words_in_cells_are_seen_on_any_page():
    """They were dropped where they were white, as the ground of a figure is."""
    cells = {"creep": {"creep": 3.0, "delay": 1.0}, "delay": {"delay": 4.0}}
    page = render("campaign.html", **empty_campaign(confusion_figure(cells)))
    assert ON_DARK in page
    assert ON_LIGHT in page


def empty_campaign(figure):
    run = {"set": "tuning", "version": "0", "commit": "", "code": "", "cpu_hours": 0.0}
    return {
        "run": run, "cases": 8, "by_kind": {}, "numbers": [], "confusion": figure, "accuracy": None, "coverage": None,
        "wrong": [],
    }  # fmt: skip


@pytest.mark.parametrize("template", ["gap", "campaign", "demo"])
def test_sections_are_called_by_what_they_answer(template):
    text = (Path(page_module.__file__).parent / "templates" / f"{template}.html").read_text()
    headings = re.findall(r"<h2>(.*?)</h2>", text)
    assert headings
    assert [heading for heading in headings if not heading.endswith("?")] == []


@pytest.mark.parametrize(
    ("called", "said"),
    [
        (["/usr/bin/phaselead", "verify", "my file.csv"], "phaselead verify 'my file.csv'"),
        (["/x/phaselead/__main__.py", "demo"], "phaselead demo"),
        (["/usr/bin/jupyter-lab", "demo"], ""),
        (["/home/me/fit it.py", "a.csv"], "python 'fit it.py' a.csv"),
        (["/x/ipykernel_launcher.py", "-f", "kernel.json"], ""),
    ],
)
def test_a_page_says_which_command_made_it(monkeypatch, called, said):
    monkeypatch.setattr("sys.argv", called)
    assert command_line() == said
    page = render("result.html", title="t", lead=[], cards=[], parts=[])
    assert f"<code>{escape(said)}</code>" in page if said else "<footer>Written by phaselead 0.1.0." in page


def test_recordings_that_are_called_alike_are_told_apart_by_their_folders():
    every = [
        Source(path, f"{i:064x}") for i, path in enumerate(["a/rec.csv", "b/rec.csv", "/tmp/other.csv", "rec.csv", ""])
    ]
    ((_, trained), (_, held)) = Origin({"train": every[:1] * 2, "hold out": every[1:]}).used()
    assert [row["name"] for row in trained] == ["a/rec.csv"]
    assert [row["name"] for row in held] == ["b/rec.csv", "other.csv", "rec.csv", ""]
