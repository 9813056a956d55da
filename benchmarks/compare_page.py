"""docs/compare.md and its figure, from what compare.py measured."""

from __future__ import annotations

import json
from pathlib import Path as File

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from phaselead.drawing import BLUE, DPI, GREEN, GREY, ORANGE, RC
from rivals import RIVALS

DOCS = File(__file__).parents[1] / "docs"
FIGURE = "images/compare.png"
PUBLISHED = (
    ("Xu and Li 2010, FF / PID / FF+PID", "60 um, 5 Hz", "5.2 / 17.2 / 1.5", ""),
    ("Zou and others 2004, inversion feed-forward", "32 um scan, 5 Hz", "1.12", "0.60"),
    ("", "30 Hz", "1.14", "0.64"),
    ("", "50 Hz", "1.46", "0.73"),
    ("", "90 Hz", "3.5", "1.7"),
    ("", "150 Hz", "3.4", "1.7"),
    ("learning, Math. Probl. Eng. 2014, 856706", "", "0.15", ""),
    ("Fleming and Leang 2010, force sensor", "10 Hz", "0.46", ""),
    ("Bazaei and others 2016, spiral scan, of its diameter", "", "0.31", ""),
)

HEAD = """# Compared with others' controllers

The controllers of the paper, three that it cites, and ours, on simulated stages and eight paths. `make compare`
measures all of it and writes this page; a run that is cut short goes on where it was. Nothing here has run on silicon,
and every stage is one of our own [virtual ones](xyz250.md).

## What is compared

| name | what it is | made from |
|---|---|---|
| FF, PID, FF+PID | Xu and Li 2010, eqs. 6 to 13 | polynomials fitted to the sines; gains: below |
| lead look-up | phase lead and gain by a table, self-tuning ([7] there) | the sines, the measured response |
| Smith predictor | gain and dead time, H-infinity bound on their ranges ([6]) | the sines, the measured response |
| PI inverse | inverse of a rate-dependent Prandtl-Ishlinskii operator, 28 parameters ([9]) | the sines |
| ours, one shot | `inverse+pid` as `identify` leaves it | the sines |
| ours, learned | the same after `learn --trials 10` | and ten trials |
| ours, tuned | `inverse+pid` with the gains of `tune` | the sines, the measured response |

**Rivals** are in `benchmarks/rivals/`, in double precision, and no part of the product. The originals of [6], [7] and
[9] could not be read: they are made from what Xu and Li and later work say of them and from the theory that they rest
on, which each file names. So a figure here is of that controller as it is written there, not of its authors' own. They
know of nothing but their feed-forward and feedback: what a published controller does not have (a model of the first
mode, for one) was not added.

**The same for all**: one identification (64 sines, 0.5 to 10 V at 1 to 20 Hz) and one measured response of the stage as
it is, 5 kHz, 30 us from sample to output, the stage's noise and 16-bit converters, limits of voltage and slew, the lag
of the sensor's data sheet (every path is asked for as late as the sensor shows it), and a join of six periods of the
first mode from rest into the path. The paper's gains are scaled to a stage by its gain and first mode, and halved until
the loop on the measured response has the margin that they have on `xyz250`.

**Judged** is the true position against the path as it was written: % of swing, over the last four periods ("steady")
and over the first. One seed of the sensor's noise. "rail": the sensor reached its end, and the run was stopped;
"stopped" and "refused" are what our device or host said instead.

Paths are scaled by travel and pace: on `xy30` 0.12 of the swing at twice the frequency, on `x100` 0.4 at twice, on
`x500` 2 at 0.4. A stage "-off" has 20 % less gain, loops 20 % wider and modes 20 % lower than the one that everything
was made on.
"""


def write_page(out: File, names: list[str]) -> None:
    """The page and its figure, of the cases that are complete."""
    found = {name: json.loads((out / f"{name}.json").read_text()) for name in names if (out / f"{name}.json").exists()}
    columns = _columns(found)
    whole = {name: rows for name, rows in found.items() if all(len(row) == len(columns) for row in rows.values())}
    missing = [name for name in names if name not in whole]
    parts = [HEAD]
    if missing:
        parts.append(f"Not measured yet: {', '.join(f'`{name}`' for name in missing)}.\n")
    parts.append(f"## What came out\n\n![Largest error by path and controller]({FIGURE})\n")
    for name, rows in whole.items():
        parts.append(f"### {name}\n\nSteady, largest / rms, % of swing:\n\n{_table(rows, columns, _steady)}")
        parts.append(f"First period, largest:\n\n{_table(rows, columns, _first)}")
    parts.append(_who_wins(whole))
    parts.append(_published())
    (DOCS / "compare.md").write_text("\n".join(parts))
    _draw(whole, columns)


def _columns(found: dict) -> list[str]:
    names: dict[str, None] = {}
    for rows in found.values():
        for row in rows.values():
            names.update(dict.fromkeys(row))
    return [*(name for name in RIVALS if name in names), *(name for name in names if name not in RIVALS)]


def _steady(cell: dict) -> str:
    return _ended(cell) or f"{cell['steady_max']:.2g} / {cell['steady_rms']:.2g}"


def _first(cell: dict) -> str:
    return _ended(cell) or f"{cell['first_max']:.2g}"


def _ended(cell: dict) -> str:
    return cell.get("ended", "").partition(":")[0]


def _table(rows: dict, columns: list[str], said) -> str:
    lines = [f"| path | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    lines += [f"| {path} | {' | '.join(said(row[name]) for name in columns)} |" for path, row in rows.items()]
    return "\n".join(lines) + "\n"


def _largest(cell: dict) -> float:
    return cell.get("steady_max", np.inf)


def _who_wins(whole: dict) -> str:
    lost, paths = [], 0
    for case, rows in whole.items():
        for path, row in rows.items():
            paths += 1
            rivals, own = ({n: _largest(c) for n, c in row.items() if (n in RIVALS) == is_rival} for is_rival in (1, 0))
            best, one_shot = min(rivals, key=rivals.__getitem__), own["ours, one shot"]
            if rivals[best] < min(own.values()):
                lost.append(f"- {case}, {path}: {best} ({rivals[best]:.2g} %) before all of ours")
            elif rivals[best] < one_shot:
                lost.append(
                    f"- {case}, {path}: {best} ({rivals[best]:.2g} %) before ours in one shot ({one_shot:.2g} %)"
                )
    said = "\n".join(lost) if lost else "No rival had a smaller largest error on any of them."
    return f"## Where a rival wins\n\nOf {paths} paths, by the largest steady error:\n\n{said}\n"


def _published() -> str:
    lines = ["| source | path | largest, % | rms, % |", "|---|---|---|---|"]
    lines += [f"| {' | '.join(row)} |" for row in PUBLISHED]
    return (
        "## Published figures\n\nOn other stages, measured by their own sensors; they are no comparison, but show "
        "where the field is.\n\n" + "\n".join(lines) + "\n"
    )


def _draw(whole: dict, columns: list[str]) -> None:
    with mpl.rc_context(RC):
        figure = Figure(figsize=(9, 2.6 * len(whole)))
        for i, (case, rows) in enumerate(whole.items(), 1):
            axes = figure.add_subplot(len(whole), 1, i)
            for j, name in enumerate(columns):
                color = GREY if name in RIVALS else (BLUE, GREEN, ORANGE)[j % 3]
                values = [_largest(row[name]) for row in rows.values()]
                values = [value if np.isfinite(value) else np.nan for value in values]
                axes.semilogy(range(len(values)), values, "oxs^v+D"[j % 7], color=color, label=name, markersize=6)
            axes.set_ylabel("largest error,\n% of swing")
            axes.set_title(case, loc="left")
            axes.set_xticks(range(len(rows)), [path.partition(",")[0] for path in rows], rotation=12, fontsize=8)
            if i == 1:
                axes.legend(ncols=3, loc="upper left", bbox_to_anchor=(0, 1.6))
        figure.savefig(DOCS / FIGURE, dpi=DPI)
