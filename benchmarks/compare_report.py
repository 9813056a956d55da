"""The comparison as a page like that of every other result: out/compare/compare.html."""

from __future__ import annotations

from pathlib import Path as File

from markupsafe import Markup
from matplotlib.figure import Figure

from phaselead.record import Source, file_sha256, write_text
from phaselead.report.origin import Origin
from phaselead.report.page import render
from phaselead.report.results import Part
from phaselead.result import Table
from rivals import RIVALS

COMMAND = "make compare"
NO_ERROR = float("inf")
OF = "Largest / rms over the last four periods, % of swing."


def write_report(out: File, whole: dict, columns: list[str], figure: Figure, said) -> None:
    """The page of the cases in ``whole``; ``said`` writes the steady errors of a cell."""
    parts = [
        Part(
            "How large is the largest error, by path and controller?",
            ["Ours in colour, others grey. A run that did not finish is on the line at the top."],
            (),
            figure,
            "True position against the path as it was written, over the last four periods, % of swing.",
        ),
        *(Part(f"How far off is each controller on {name}?", [OF], [_table(rows, columns, said)])
          for name, rows in whole.items()),
    ]  # fmt: skip
    page = render(
        "result.html",
        title="Compared with others' controllers",
        lead=["Simulated stages; nothing here has run on silicon. What is compared and why: docs/compare.md."],
        cards=_cards(whole),
        parts=parts,
        origin=Origin(_sources(out, whole), [f"Measured by `{COMMAND}`, which goes on where it was."]),
    )
    write_text(out / "compare.html", page)


def _table(rows: dict, columns: list[str], said) -> Markup:
    cells = tuple((path, *(said(row[name]) if name in row else "-" for name in columns)) for path, row in rows.items())
    return Markup(Table(("path", *columns), cells).html())


def _cards(whole: dict) -> list[dict[str, str]]:
    """In how many pairs of stage and path which side has the smallest error."""
    pairs = [row for rows in whole.values() for row in rows.values()]
    best = [min(row, key=lambda name: row[name].get("steady_max", NO_ERROR)) for row in pairs]
    ours = sum(name not in RIVALS for name in best)
    return [
        {"value": f"{ours} of {len(pairs)}", "label": "pairs of stage and path in which one of ours is nearest"},
        {"value": f"{len(pairs) - ours} of {len(pairs)}", "label": "in which a rival is nearer than all of ours"},
    ]


def _sources(out: File, whole: dict) -> dict[str, list[Source]]:
    """The figures as they were kept, and the run behind each."""
    kept = [out / f"{name}.json" for name in whole]
    runs = {
        f"Runs on {name}": [
            Source(f"{path}, {controller}", cell["sha256"])
            for path, row in rows.items()
            for controller, cell in row.items()
            if "sha256" in cell
        ]
        for name, rows in whole.items()
    }
    return {"Figures of every run": [Source(file.name, file_sha256(file)) for file in kept], **runs}
