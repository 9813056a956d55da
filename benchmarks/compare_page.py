"""docs/compare.md and its figure, and the report, from what compare.py measured."""

from __future__ import annotations

import json
import re
from pathlib import Path as File

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from compare_report import write_report
from phaselead.drawing import BLUE, DPI, GREEN, GREY, ORANGE, PURPLE, RC
from rivals import RIVALS

DOCS = File(__file__).parents[1] / "docs"
FIGURE = "images/compare.png"
MARKERS = "oxs^v+DphP"
NOT_FINISHED = 600.0
"""Where the figure has runs that ended early, %."""
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
| ours, one shot | `inverse+pid` as `identify --no-creep` leaves it | the sines |
| ours, learned | the same after `learn --trials 10` | and ten trials |
| ours, tuned | `inverse+pid` with the gains of `tune` | the sines, the measured response |
| ours, tuned and learned | the same after `learn --trials 10` | and ten trials |

**Rivals** are in `benchmarks/rivals/`, in double precision, and no part of the product. The originals of [6], [7] and
[9] could not be read: they are made from what Xu and Li and later work say of them and from the theory that they rest
on, which each file names. So a figure here is of that controller as it is written there, not of its authors' own. They
know of nothing but their feed-forward and feedback: what a published controller does not have (a model of the first
mode, for one) was not added.

**The same for all**: one identification (64 sines, 0.5 to 10 V at 1 to 20 Hz) and one measured response of the stage as
it is, 5 kHz, 30 us from sample to output, the stage's noise and 16-bit converters, limits of voltage and slew, the lag
of the sensor's data sheet (every path is asked for as late as the sensor shows it), and a join of six periods of the
first mode from rest into the path. The hold that `identify` learns creep from is left out, since the rivals make
nothing of it: ours inverts no creep here, its loop takes it out. The paper's gains are scaled to a stage by its gain
and first mode, and halved until the loop on the measured response has the margin that they have on `xyz250`.

**Judged** is the true position against the path as it was written: % of swing, over the last four periods ("steady")
and over the first. Ours rounds corners that the output is too slow for ([corners](tracking.md#corners)), and they
count as error like all else. One seed of the sensor's noise. "rail": the sensor reached its end, and the run was
stopped; "stopped" and "refused" are what our device or host said instead.

Paths are named as they are on `xyz250`. On other stages they are scaled by travel and pace: on `xy30` 0.12 of the swing
at twice the frequency, on `x100` 0.4 at twice (so that "60 um 5 Hz" is 24 um at 10 Hz there), on `x500` 2 at 0.4. A
stage "-off" has 20 % less gain, loops 20 % wider and modes 20 % lower than the one that everything was made on; what
was learned for it was learned on it.
"""


WHY = """**Why**, as far as it was looked into:

- Of ours on `xyz250-off`: both loops are designed for modes 10 % up and down, and there they are 20 % down. They begin
  to swing, and the device stops; `learn` can't begin either. The stage has to be tuned again.
- The one shot on `xyz250-hard` swings up slowly, along the 60 um sine at 20 Hz to 7.9 %. Trials take it out: they turn
  the loop down.
- Without `tune` ours does not finish on `x500`, but for one learned path: the gains of `identify` are designed for its
  model, which lacks the second mode, and their loop rings there.
- The 10 um sine on both "-off" stages is faster than their first mode, where a stage moves against what drives it. 50 %
  is what a stage has that stays at the middle of the path, and what the Smith predictor does. Nothing follows it from
  what it was made on.
"""


def write_page(out: File, names: list[str]) -> None:
    """The page and its figure, of the cases in which every controller was tried; "-" is not measured yet."""
    found = {name: json.loads((out / f"{name}.json").read_text()) for name in names if (out / f"{name}.json").exists()}
    columns = _columns(found)
    whole = {name: rows for name, rows in found.items() if set().union(*rows.values()) == set(columns)}
    missing = [name for name in names if name not in whole]
    parts = [HEAD]
    if missing:
        parts.append(f"Not measured: {', '.join(f'`{name}`' for name in missing)}.\n")
    parts.append(f"## What came out\n\n![Largest error by path and controller]({FIGURE})\n")
    for name, rows in whole.items():
        parts.append(f"### {name}\n\nSteady, largest / rms, % of swing:\n\n{_table(rows, columns, _steady)}")
        parts.append(f"First period, largest:\n\n{_table(rows, columns, _first)}")
    parts.append(_who_wins(whole))
    parts.append(_published())
    (DOCS / "compare.md").write_text("\n".join(parts))
    figure = drawn(whole, columns)
    figure.savefig(DOCS / FIGURE, dpi=DPI)
    write_report(out, whole, columns, figure, _steady)


def _columns(found: dict) -> list[str]:
    names: dict[str, None] = {}
    for rows in found.values():
        for row in rows.values():
            names.update(dict.fromkeys(row))
    return [*(name for name in RIVALS if name in names), *(name for name in names if name not in RIVALS)]


def _steady(cell: dict) -> str:
    return _ended(cell) or f"{_said(cell['steady_max'])} / {_said(cell['steady_rms'])}"


def _first(cell: dict) -> str:
    return _ended(cell) or _said(cell["first_max"])


def _ended(cell: dict) -> str:
    return cell.get("ended", "").partition(":")[0]


def _table(rows: dict, columns: list[str], said) -> str:
    lines = [f"| path | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    lines += [
        f"| {path} | {' | '.join(said(row[name]) if name in row else '-' for name in columns)} |"
        for path, row in rows.items()
    ]
    return "\n".join(lines) + "\n"


def _largest(cell: dict) -> float:
    return cell.get("steady_max", np.inf)


def _said(percent: float) -> str:
    """Two places, and none of them a power of ten."""
    return f"{percent:.0f}" if percent >= 10 else f"{percent:.2g}"


def _who_wins(whole: dict) -> str:
    """A sentence for each place where a rival, or our own loop as identify leaves it, beats the tuned one."""
    before_all, before_tuned, before_one_shot, untuned, paths = [], [], [], [], 0
    for case, rows in whole.items():
        for path, row in rows.items():
            paths += 1
            rivals = {name: _largest(cell) for name, cell in row.items() if name in RIVALS}
            own = {name: _largest(cell) for name, cell in row.items() if name not in RIVALS}
            best, tuned, one_shot = min(rivals, key=rivals.__getitem__), own["ours, tuned"], own["ours, one shot"]
            place = f"- `{case}`, {path}:"
            if rivals[best] < min(own.values()):
                before_all.append(f"{place} {best} is {_off(rivals[best])}; of ours {_best(min(own.values()))}.")
            elif rivals[best] < tuned:
                before_tuned.append(f"{place} {best} is {_off(rivals[best])}, ours tuned {_off(tuned)}.")
            elif rivals[best] < one_shot:
                before_one_shot.append(f"{place} {best} is {_off(rivals[best])}, ours in one shot {_off(one_shot)}.")
            if one_shot < tuned:
                untuned.append(f"{place} {_off(one_shot)} in one shot, {_off(tuned)} tuned.")
    parts = [f"## Where ours is not the best\n\nOf {paths} pairs of stage and path, by the largest steady error.\n"]
    for title, found in (
        ("A rival before all of ours", before_all),
        ("A rival before ours tuned, but not before all of ours", before_tuned),
        ("A rival before ours in one shot, but not before ours tuned", before_one_shot),
        ("Ours in one shot before ours tuned", untuned),
    ):
        parts.append(f"**{title}**: {len(found)}.\n")
        parts.extend(["\n".join(found) + "\n"] if found else [])
    return "\n".join([*parts, WHY])


def _off(percent: float) -> str:
    return f"{_said(percent)} % off" if np.isfinite(percent) else "did not finish"


def _best(percent: float) -> str:
    return f"the best is {_off(percent)}" if np.isfinite(percent) else "none finished"


def _published() -> str:
    lines = ["| source | path | largest, % | rms, % |", "|---|---|---|---|"]
    lines += [f"| {' | '.join(row)} |" for row in PUBLISHED]
    return (
        "## Published figures\n\nOn other stages, measured by their own sensors; they are no comparison, but show "
        "where the field is.\n\n" + "\n".join(lines) + "\n"
    )


def drawn(whole: dict, columns: list[str]) -> Figure:
    """A row of points a path; a run that did not finish is on the line at the top."""
    colors = dict(zip((name for name in columns if name not in RIVALS), (BLUE, GREEN, ORANGE, PURPLE), strict=True))
    with mpl.rc_context(RC):
        figure = Figure(figsize=(9, 2.3 * len(whole) + 1.2))
        rows_of_axes = figure.subplots(len(whole), sharex=True, sharey=True, squeeze=False)[:, 0]
        for axes, (case, rows) in zip(rows_of_axes, whole.items(), strict=True):
            for j, name in enumerate(columns):
                values = np.array([_largest(row.get(name, {})) for row in rows.values()])
                values[~np.isfinite(values)] = NOT_FINISHED
                aside = np.arange(len(values)) + 0.08 * (j - (len(columns) - 1) / 2)
                look = {"color": colors.get(name, GREY), "markersize": 6 if name in colors else 4.5}
                axes.semilogy(aside, values, MARKERS[j], linestyle="", label=name, **look)
            axes.axhline(NOT_FINISHED, color=GREY, linewidth=0.7, linestyle=":", zorder=0)
            axes.set_ylabel("largest error,\n% of swing")
            axes.set_title(case, loc="left")
            axes.set_yticks([0.01, 0.1, 1, 10, 100, NOT_FINISHED], ["0.01", "0.1", "1", "10", "100", "ended early"])
            axes.minorticks_off()
            axes.set_xticks(range(len(rows)), [f"{path.split()[0]}\n{_where(path)}" for path in rows], fontsize=8)
            axes.grid(visible=False, axis="x")
        figure.legend(*rows_of_axes[0].get_legend_handles_labels(), ncols=4, loc="outside upper left")
        return figure


def _where(path: str) -> str:
    """Swing and pace of a path, out of its name."""
    found = re.findall(r"\d+ (?:um|Hz)", path)
    return ", ".join(found[:2])
