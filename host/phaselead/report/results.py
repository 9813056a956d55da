"""Pages of results: of a fit, a verification, a run, a learning; figures and tables under what they answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import singledispatch
from typing import Any

from markupsafe import Markup
from matplotlib.figure import Figure

from phaselead.control import Learned, Run, Tuned
from phaselead.errors import BadInput
from phaselead.identify import FitResult, Verifications
from phaselead.quantity import digits
from phaselead.record import Source
from phaselead.report.axis_figures import (
    CREEP_FROM_S,
    bode_figure,
    creep_figure,
    noise_figure,
    step_figure,
    timed,
)
from phaselead.report.origin import SHOWN_DIGITS, Origin, of_device, of_run, of_stage
from phaselead.report.page import render
from phaselead.report.run_figures import runs_figure
from phaselead.result import Table

WORST = "The record that it fits worst, by its share of the range."
CAPTION_OF_LEARNING = (
    "Left: the error of each trial over its last four periods; trial 0 is the path as it was asked for, the grey line "
    "the trial that is kept. Right: what the kept table adds to one period of the path. The error is that of the "
    "measured position against the path that was asked for; where the true position follows, against what a sensor as "
    "late as the model's would show of it."
)


@dataclass(frozen=True)
class Part:
    """One question and what answers it."""

    question: str
    said: Sequence[str] = ()
    tables: Sequence[Markup] = field(default_factory=tuple)
    figure: Figure | None = None
    caption: str = ""


@singledispatch
def result_page(result: Any) -> str:
    """The page as HTML. Raises BadInput for what has none."""
    raise BadInput(
        f"a {type(result).__name__} has no page; give the result itself, of gap, fit, verify, track, learn or tune"
    )


@result_page.register
def _(result: FitResult) -> str:
    parts = [
        Part(
            "What does the model leave?",
            result.report.remarks(),
            (),
            result.plot(),
            WORST,
        ),
        *(
            Part(
                f"How good is the {view} view on records that it has not seen?", (), _html(found.tables()), found.plot()
            )
            for view, found in result.held_out.items()
        ),
        Part("What is the loop?", (), (), result.model.plot(), "The model, driven slowly."),
        *(_parts_of_axes(result) if timed(result) else ()),
        Part("What are its numbers?", (), _html(result.model.tables())),
    ]
    held_out = [Source(one.file, one.sha256) for found in result.held_out.values() for one in found]
    origin = Origin(
        {
            "Recordings that it was fitted on": [one.traced for one in result.records],
            "Held-out recordings": held_out,
            "Recordings of a hold, for creep": [
                Source(f"{axis}, held", held.traced.sha256) for axis, held in result.holds.items()
            ],
        },
        [of_stage(result.model), *of_device([*result.records, *result.holds.values()])],
    )
    return _page(f"The stage file “{result.model.name}”", result.summary(), _cards_of_fit(result), parts, origin)


def _parts_of_axes(result: FitResult) -> list[Part]:
    noise, creep = noise_figure(result), creep_figure(result)
    tabled = any(axis.table is not None for axis in result.model.axes.values())
    none = ["No creep is known of this model: `phaselead identify` holds each axis and fits its creep."]
    return [
        Part(
            "How does it answer each frequency?", (), (), bode_figure(result),
            "Lines: the model, from the step below."
            + (" Points: the sines of the table view; gain grows with the swing." if tabled else ""),
        ),
        Part("How does it answer a step?", (), (), step_figure(result), "The model; no step was driven."),
        Part(
            "How far does it go on while it is held?", () if creep else none, (), creep,
            f"Counted from {CREEP_FROM_S:g} s after the step.",
        ),
        *([Part(
            "How much of what is left is noise?", (), (), noise,
            "What the model leaves of the quietest record of each axis; dashed: white noise as large as the sensor's.",
        )] if noise else []),
    ]  # fmt: skip


@result_page.register
def _(result: Verifications) -> str:
    said, tables = _parted(result.tables())
    part = Part("How far is the model from each record?", said, tables, result.plot())
    cards = []
    if len(result):
        by_mean, by_most = max(result, key=lambda one: one.mean_pct), max(result, key=lambda one: one.max_pct)
        cards = [
            {
                "value": f"{digits(by_mean.mean_pct, 2)} %",
                "label": f"of its range: largest mean error, on {by_mean.file}",
            },
            {"value": f"{digits(by_most.max_pct, 2)} %", "label": f"of its range: largest error, on {by_most.file}"},
        ]
    of_model = f"The stage file: content {result.model_sha256[:SHOWN_DIGITS]}."
    judged = {"Recordings that it was judged on": [Source(one.file, one.sha256) for one in result]}
    origin = Origin(judged, [of_model] if result.model_sha256 else [])
    title = f"“{result.model_name or 'the model'}” on other records"
    return _page(title, [f"The {result.view} view."], cards, [part], origin)


@result_page.register
def _(result: Run) -> str:
    said, tables = _parted(result.tables())
    cards = [
        {"value": f"{figures['max_um']:.3g} µm", "label": f"largest error of {axis}, {figures['judged']}"}
        for axis, figures in result.of_axes()
        if figures["max_um"] is not None
    ]
    parts = [Part("How near did it stay to its path?", said, tables, result.plot())]
    if cards:
        parts.append(
            Part(
                "At which frequencies is the error?", (), (), runs_figure([result.recording], "spectrum", titled=False)
            )
        )
    origin = Origin({"The recording": [result.recording.traced]}, of_run(result.recording))
    return _page(f"A run in mode {result.mode}", [result.recording.source], cards, parts, origin)


@result_page.register
def _(result: Learned) -> str:
    table, *said = result.tables()
    assert isinstance(table, Table)
    cards = [
        {
            "value": f"{rms_um:.3g} µm",
            "label": f"rms error of {axis} in the trial that is kept, number {result.best.number}",
        }
        for axis, rms_um in result.best.rms_um.items()
    ]
    part = Part("What did each trial leave?", (), _html([table]), result.plot(), CAPTION_OF_LEARNING)
    path = result.wave or "a path"
    trials = [trial.source for trial in result.trials if trial.source.sha256]
    facts = [f"Learned for the stage file with the content {result.stage_sha256[:SHOWN_DIGITS]}."]
    origin = Origin({"The recording of each trial": trials}, facts)
    return _page(f"Learned: {path}", [f"{line}." for line in (table.title, *said)], cards, [part], origin)


@result_page.register
def _(result: Tuned) -> str:
    said, tables = _parted(result.tables())
    closed = result.closed
    cards = [
        {"value": f"{closed.bandwidth_Hz:.3g} Hz", "label": "bandwidth (-3 dB), measured"},
        {"value": f"{closed.peak_sensitivity:.2f}", "label": "peak sensitivity, measured"},
        {"value": f"{result.predicted.peak_sensitivity:.2f}", "label": "the largest predicted over all it is for"},
    ]
    caption = (
        "Above: the response, its phase, and what is heard where nothing is driven. Below: the loop about the circle "
        "that the peak sensitivity allows, |S| and |T|; blue: predicted for every gain and place of the modes, dots: "
        "measured."
    )
    part = Part("Has the loop its margin?", said, tables, result.plot(), caption)
    origin = Origin({"Recordings of the open and of the closed loop": result.sources}, [of_stage(result.model)])
    return _page(f"The loop of axis {result.axis}", [result.gains.origin or ""], cards, [part], origin)


def _cards_of_fit(result: FitResult) -> list[dict[str, str]]:
    """What is left of each axis."""
    times = ((axis, model.time) for axis, model in result.axes.items())
    return [
        {"value": f"{digits(view.residual_um_rms, 2)} µm", "label": f"rms that the model of {axis} leaves"}
        for axis, view in times
        if view is not None
    ]


def _parted(parts: Sequence[Table | str]) -> tuple[list[str], list[Markup]]:
    """Sentences and tables."""
    return [part for part in parts if isinstance(part, str)], _html(parts)


def _html(parts: Sequence[Table | str]) -> list[Markup]:
    return [Markup(part.html()) for part in parts if isinstance(part, Table)]


def _page(title: str, lead: Sequence[str], cards: list[dict[str, str]], parts: Sequence[Part], origin: Origin) -> str:
    return render("result.html", title=title, lead=list(filter(None, lead)), cards=cards, parts=parts, origin=origin)
