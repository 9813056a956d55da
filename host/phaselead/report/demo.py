"""The demo's report: its tables and figures from the results of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from phaselead.control import Run
from phaselead.identify import Experiment, Identified, Verification, compare_with_table_1
from phaselead.model import Stage
from phaselead.record import Recording, Source, file_sha256
from phaselead.report import figures
from phaselead.report.origin import SHOWN_DIGITS, Origin, of_stage
from phaselead.report.page import write_page
from phaselead.report.paper import RATIOS, TRACKING, VERIFICATION

FROM_FILES = (
    "phaselead verify --model stage.toml open-x-5V-5Hz.h5 open-x-3V-15Hz.h5",
    "phaselead verify --model stage.toml --view table open-x-5V-5Hz.h5 open-x-3V-15Hz.h5",
    "phaselead plot track-pid.h5 track-ff.h5 track-ff-pid.h5 --of error -o errors.png",
    "phaselead replay track-ff-pid.h5",
)
"""In the folder of the page: its own numbers."""
ANEW = (
    "phaselead identify --axis x,y,z -o new.toml",
    "phaselead log record --drive sine:5V@5Hz --duration 1 -o new.h5",
    "phaselead verify --model new.toml new.h5",
    "phaselead track sine:60um@5Hz --model new.toml --mode pid --gains paper",
    "phaselead track sine:60um@5Hz --model new.toml --mode ff",
    "phaselead track sine:60um@5Hz --model new.toml --mode ff+pid --gains paper",
)


@dataclass(frozen=True)
class HeldOut:
    """A verification input from rest, and how both views did on it."""

    experiment: Experiment
    recording: Recording
    models_um: dict[str, np.ndarray[Any, np.dtype[np.float64]]]
    verifications: dict[str, Verification]


@dataclass(frozen=True)
class DemoResults:
    """Everything the report draws on."""

    stage: Stage
    identified: Identified
    held_out: Sequence[HeldOut]
    runs: Mapping[str, Run]
    loops: Sequence[Recording]
    across: Recording
    replayed_ticks: int
    build_id: str
    model_crc: int


def write_demo_report(path: Path, results: DemoResults) -> None:
    """Writes the page, whole or not at all."""
    table = results.stage.axis("x").table
    assert table is not None
    across_um = {name: axis.x_um for name, axis in results.across.axes.items() if axis.x_um is not None}
    driven_V = results.across.axes["x"].u_V
    assert driven_V is not None
    write_page(
        path,
        "demo.html",
        stage_name="xyz250, the built-in virtual stage",
        cards=cards(results),
        tracking_rows=tracking_rows(results.runs),
        tracking_figure=figures.tracking({mode: tracked(run) for mode, run in results.runs.items()}),
        verifications=[verification_part(item) for item in results.held_out],
        grid_sentence=grid_sentence(results.identified),
        surfaces_figure=figures.surfaces(table),
        coefficient_rows=[row for row in compare_with_table_1(table)],
        coefficient_remark=(
            "Single coefficients of the two stages need not agree: the regressors are strongly correlated over the "
            "rectangle, so the surfaces are what to compare, and ours is a different stage. The standard errors come "
            "from the covariance of the whole regression, lack of fit included."
        ),
        axes_figure=figures.loops_of_axes(driven_V, across_um, "x"),
        cross_talk_pct=cross_talk_pct(across_um),
        frequency_figure=figures.loops_of_frequencies([last_period(r) for r in results.loops]),
        comparison_rows=comparison_rows(results),
        replayed_ticks=f"{results.replayed_ticks:,}",
        replay_sentence="every DAC code came out the same",
        from_files=FROM_FILES,
        anew=ANEW,
        origin=origin_of(path.parent, results),
    )


def origin_of(folder: Path, results: DemoResults) -> Origin:
    """The runs beside the page by the hashes of their files, the records of the identification by those of their
    samples."""
    files = {file.name: Source(file.name, file_sha256(file)) for file in sorted(folder.glob("*.h5"))}
    return Origin(
        {
            "Runs that were tracked": [one for name, one in files.items() if name.startswith("track")],
            "Records in open loop, each from rest": [one for name, one in files.items() if name.startswith("open")],
            "Records that the stage file was fitted on": [one.traced for one in results.identified.recordings],
            "Records of a hold, for creep": [one.traced for one in results.identified.holds.values()],
        },
        [
            of_stage(results.stage),
            f"As the device holds it: CRC {results.model_crc:08x}.",
            f"Recorded by the firmware in the host process, build {results.build_id[:SHOWN_DIGITS]}.",
        ],
    )


def cards(results: DemoResults) -> list[dict[str, str]]:
    """The figures a reader looks for first."""
    errors = {mode: run.figures["max_um"] for mode, run in results.runs.items()}
    best = results.runs["ff+pid"].figures
    first = results.held_out[0].verifications["time"]
    return [
        {
            "value": f"{best['max_um']:.2f} µm",
            "label": f"largest error of FF + PID, {best['max_pct']:.2f} % of 60 µm",
        },
        {"value": f"{errors['pid'] / errors['ff+pid']:.1f} ×", "label": "better than PID alone"},
        {"value": f"{first.mean_pct:.2f} %", "label": "mean model error, 5 V 5 Hz, time view, held out"},
        {"value": f"{results.replayed_ticks:,}", "label": "ticks replayed bit for bit"},
    ]


def tracked(run: Run) -> figures.TrackedRun:
    """One run as the figure takes it."""
    record = run.recording.axes["x"]
    stream = run.capture.axes["x"]
    assert record.r_um is not None
    assert record.x_um is not None
    assert stream.feedforward is not None
    assert stream.feedback is not None
    start = int(np.searchsorted(run.capture.ticks, run.capture.start_tick))
    rows = slice(start, start + len(run.recording.t_s))
    return figures.TrackedRun(
        run.recording.t_s,
        record.r_um,
        record.x_um,
        stream.feedforward[rows] / 2.0**11,
        stream.feedback[rows] / 2.0**11,
    )


def tracking_rows(runs: Mapping[str, Run]) -> list[dict[str, Any]]:
    """One row per controller, the paper's figure in the last column."""
    return [
        {
            "name": figures.MODE_NAMES[mode],
            "max_um": run.figures["max_um"],
            "max_pct": run.figures["max_pct"],
            "rms_um": run.figures["rms_um"],
            "max_um_mean_removed": run.figures["max_um_mean_removed"],
            "from_rest_um": run.figures["from_rest"]["max_um"],
            "from_rest_mean_removed_um": run.figures["from_rest"]["max_um_mean_removed"],
            "paper_um": TRACKING[mode].value,
        }
        for mode, run in runs.items()
    ]


def verification_part(item: HeldOut) -> dict[str, Any]:
    """Heading, table, figure and caption of one held-out input."""
    swing_V, f_Hz = item.experiment.swing_V, item.experiment.f_Hz
    number = 4 if swing_V == 5 else 5
    views = {"table": "table (the paper's)", "time": "time domain"}
    rows = [vars(item.verifications[view]) | {"view": label} for view, label in views.items()]
    record = item.recording.axes["x"]
    assert record.x_um is not None
    return {
        "title": f"{swing_V:g} V, {f_Hz:g} Hz",
        "rows": rows,
        "figure": figures.verification(item.recording.t_s, record.x_um, item.models_um),
        "caption": f"The paper's Fig. {number}: measurement and both views; below, measurement minus model.",
    }


def grid_sentence(identified: Identified) -> str:
    """What the experiment consisted of."""
    sources = [r.source.split("-") for r in identified.recordings]
    levels = sorted({float(s[1].removesuffix("V")) for s in sources})
    frequencies = sorted({float(s[2].removesuffix("Hz")) for s in sources})
    axes = sorted({s[0] for s in sources})
    return (
        f"{len(sources)} sines on axes {', '.join(axes)}: {len(levels)} levels of {levels[0]:g} to {levels[-1]:g} V "
        f"peak-to-peak at {len(frequencies)} frequencies of {frequencies[0]:g} to {frequencies[-1]:g} Hz, recorded "
        "through the device without a gap, one period to settle and four to measure each; then a hold of each axis, "
        "which shows its creep."
    )


def cross_talk_pct(positions_um: Mapping[str, Any]) -> float:
    """Largest peak-to-peak of an idle axis, in per cent of the driven one's; x is driven."""
    driven = float(np.ptp(positions_um["x"]))
    return 100 * max(float(np.ptp(x)) for name, x in positions_um.items() if name != "x") / driven


def last_period(recording: Recording) -> figures.Loop:
    """The last period of an open-loop sine named AXIS-SWING-FREQUENCY."""
    f_Hz = float(recording.source.split("-")[2].removesuffix("Hz"))
    rows = slice(-round(recording.rate_Hz / f_Hz), None)
    axis = recording.axes["x"]
    assert axis.u_V is not None
    assert axis.x_um is not None
    return figures.Loop(f_Hz, axis.u_V[rows], axis.x_um[rows])


def comparison_rows(results: DemoResults) -> list[dict[str, str]]:
    """Every published figure beside ours, with a sentence on the difference."""
    rows = []
    for item in results.held_out:
        name = f"{item.experiment.swing_V:g} V {item.experiment.f_Hz:g} Hz"
        ours = item.verifications["table"]
        for paper, value in zip(VERIFICATION[name], (ours.max_pct, ours.mean_pct), strict=True):
            rows.append(comparison_row(paper, value))
    errors = {mode: run.figures["max_um"] for mode, run in results.runs.items()}
    rows += [comparison_row(TRACKING[mode], error) for mode, error in errors.items()]
    rows += [comparison_row(paper, errors["pid"] / errors[mode]) for mode, paper in RATIOS.items()]
    return rows


def comparison_row(paper: Any, ours: float) -> dict[str, str]:
    """One line of the comparison."""
    return {
        "what": paper.what,
        "paper": f"{paper.value:g} {paper.unit}",
        "ours": f"{ours:.3g} {paper.unit}",
        "remark": paper.remark,
    }
