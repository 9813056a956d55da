"""The page of a campaign: results against targets, the confusion matrix, and accuracy by size and certainty."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from phaselead.drawing import BLUE, GREY, ORANGE, figure_style, new_figure
from phaselead.record import Source, file_sha256
from phaselead.report.origin import Origin
from phaselead.report.page import write_page
from phaselead.validation import FAILED, NOTHING, UNKNOWN, reached

ON_DARK, ON_LIGHT = "#f7f7f7", "#1b1f24"
"""Of words in a cell, whose ground is the same on a light and a dark page: not the page's own black and white."""


def write_campaign_report(path: Path, result: dict[str, Any]) -> None:
    """Write the page, whole or not at all."""
    sizes = result["accuracy_by_size"]
    cases = path.with_name("cases.jsonl")
    answers = [Source(cases.name, file_sha256(cases))] if cases.is_file() else []
    write_page(
        path,
        "campaign.html",
        run=result["run"],
        cases=result["cases"],
        by_kind=result["by_kind"],
        numbers=[{**row, "text": reached(row)} for row in result["numbers"]],
        confusion=confusion_figure(result["confusion"]) if result["confusion"] else None,
        accuracy=size_figure(sizes) if sizes["mixed"] or sizes["sines"] else None,
        coverage=coverage_figure(result["accuracy_coverage"]) if result["accuracy_coverage"] else None,
        origin=Origin({"What every case was answered": answers}),
        wrong=[{**w, "text": _answer(w)} for w in result["wrong"]],
    )


def _answer(wrong: dict[str, Any]) -> str:
    if wrong["error"]:
        return str(wrong["error"])
    claims = [" or ".join(claim) for claim in wrong["said"]]
    return "; ".join(claims) or ", ".join(wrong["verdicts"])


def confusion_figure(cells: dict[str, dict[str, float]]) -> Figure:
    """Hidden effects against answers; each row sums to its number of cases."""
    truths = list(cells)
    others = sorted({name for row in cells.values() for name in row} - set(truths) - {NOTHING, UNKNOWN, FAILED})
    answers = [*truths, *others, UNKNOWN, NOTHING, FAILED]
    table = np.array([[cells[t].get(a, 0.0) for a in answers] for t in truths])
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1e-9)
    with figure_style():
        figure = new_figure(10, 1.8 + 0.3 * len(truths))
        ax = figure.subplots()
        ax.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        ax.grid(False)
        ax.set_xticks(range(len(answers)), answers, rotation=90, fontsize=7)
        ax.set_yticks(range(len(truths)), truths, fontsize=7)
        ax.set_xlabel("answered")
        ax.set_ylabel("hidden")
        for i, j in zip(*np.nonzero(table > 0.04), strict=True):
            colour = ON_DARK if share[i, j] > 0.5 else ON_LIGHT
            ax.text(j, i, f"{table[i, j]:.2g}", ha="center", va="center", fontsize=6, color=colour)
    return figure


def size_figure(sizes: dict[str, dict[str, dict[str, float]]]) -> Figure:
    """Share of right answers by size: each effect as a thin line, all together as a thick one."""
    with figure_style():
        figure = new_figure(7, 3.6)
        ax = figure.subplots()
        for name, row in sizes["mixed"].items():
            if name != "all":
                ax.plot([float(s) for s in row], [100 * v for v in row.values()], color=GREY, lw=0.6, alpha=0.5)
        for label, colour in (("mixed", BLUE), ("sines", ORANGE)):
            row = sizes[label].get("all", {})
            ax.plot([float(s) for s in row], [100 * v for v in row.values()], "o-", color=colour, label=label)
        ax.set_xscale("log")
        ax.set_ylim(-3, 103)
        ax.set_xlabel("size (multiple of the typical size)")
        ax.set_ylabel("exactly right (%)")
        ax.legend()
    return figure


def coverage_figure(points: list[dict[str, float]]) -> Figure:
    """Accuracy among the most certain answers, against the share of cases that these are."""
    with figure_style():
        figure = new_figure(7, 3.2)
        ax = figure.subplots()
        ax.plot([100 * p["coverage"] for p in points], [100 * p["accuracy"] for p in points], color=BLUE)
        ax.set_xlim(0, 100)
        ax.set_ylim(0, 103)
        ax.set_xlabel("cases answered, most certain first (%)")
        ax.set_ylabel("of these, right (%)")
    return figure
