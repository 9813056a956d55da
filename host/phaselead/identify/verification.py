"""Judging a stage file on recordings: prediction against measurement, nothing refitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from phaselead.errors import BadInput, more_like_it
from phaselead.identify.runs import AxisRun, driven_runs
from phaselead.model import Stage, TableView, predict
from phaselead.record import Recording, Samples, slow_gain

View = Literal["time", "table"]
CLEARLY_BETTER = 2.0
"""Times smaller, of a largest error."""
TIME_VIEW = 'judge the time view: --view time (in Python view="time")'


@dataclass(frozen=True)
class Verification:
    """Errors over the scored rows of one driven axis: mean = mean |e|, range = measured peak-to-peak."""

    file: str
    max_um: float
    mean_um: float
    range_um: float
    max_pct: float
    mean_pct: float
    axis: str = "x"
    sha256: str = ""
    """Of the recording's file, else of its samples."""
    gain: float | None = None
    """By which factor the measured position follows the model's, slowly; None where most of it does not."""


def verification_dict(verification: Verification) -> dict[str, Any]:
    """As it goes into JSON."""
    figures = asdict(verification)
    del figures["sha256"], figures["gain"]  # of the page and of doubts; a reader of the JSON has the file
    if verification.axis == "x":
        del figures["axis"]  # the plain form of a one-axis recording
    return figures


def verify(
    stage: Stage, recordings: Sequence[Recording], view: View = "time", *, refit_offset: bool = False
) -> list[Verification]:
    """Judge ``view`` of the stage on every driven axis of every recording that can be used.

    The time view starts from rest at 0 V before the first row; rows ahead of a window warm its memory. The
    table view answers the sine that the voltage is. ``refit_offset`` removes the mean error of each record.
    Raises BadInput for a recording of which nothing can be used.
    """
    found = []
    for recording in recordings:
        runs, left_out = driven_runs(recording)
        if not runs:
            raise BadInput(left_out[0])
        predicted = predict(stage, recording) if view == "time" else None
        sha256 = recording.traced.sha256
        for axis, run in runs.items():
            if predicted is None:
                model = _table_response(stage, run)
            else:
                stage.axis(axis)
                x = predicted.axes[axis].x_um
                assert x is not None
                model = x[run.scored]
            found.append(_judge(run, model, refit_offset, sha256))
    return found


def stood_elsewhere(stage: Stage, recordings: Sequence[Recording]) -> list[str]:
    """A line, for all in one, where a driven axis of a recording does not begin at 0 V and the time view describes it
    clearly better if the stage had long stood there, than by the step from rest at 0 V that it is judged by."""
    found = []
    for recording in recordings:
        runs, _ = driven_runs(recording)
        away = {name: run for name, run in runs.items() if not run.scored.start and not run.begins_at_0_V}
        if not away:
            continue
        stepped, stood = predict(stage, recording), predict(stage, recording, stood=True)
        for name, run in away.items():
            line = _stood(run, stepped.axes[name].x_um, stood.axes[name].x_um)
            found += [line] if line else []
    return [found[0] + more_like_it(len(found) - 1)] if found else []


def _stood(run: AxisRun, stepped_um: Samples | None, stood_um: Samples | None) -> str:
    """What to say of a run for which the two predictions (n,) in um differ; nothing where that is not clearly wrong."""
    assert stepped_um is not None
    assert stood_um is not None
    as_step, as_stood = (np.abs(run.x_um - x_um)[run.scored] for x_um in (stepped_um, stood_um))
    if as_step.max() < CLEARLY_BETTER * as_stood.max():
        return ""
    differ = np.flatnonzero(np.abs(stepped_um - stood_um)[run.scored] > as_stood.mean())
    after_s = float(run.t_s[run.scored][min(differ[-1] + 1, len(as_step) - 1)])
    return (
        f"{run.source}: begins at {run.u_V[0]:.3g} V and counts as a step from rest at 0 V, which leaves up to "
        f"{as_step.max():.3g} um; a stage that had long stood there would leave {as_stood.max():.3g}: if yours had, "
        f"score only what comes after, with the window @{after_s:.3g}:"
    )


def _judge(run: AxisRun, model: Samples, refit_offset: bool, sha256: str) -> Verification:
    measured = run.x_um[run.scored]
    error = measured - model
    if refit_offset:
        error = error - error.mean()
    largest, mean, range_um = float(np.abs(error).max()), float(np.abs(error).mean()), run.range_um
    shares_pct = 100 * largest / range_um, 100 * mean / range_um
    gain = slow_gain([(model, measured)])
    return Verification(run.source, largest, mean, range_um, *shares_pct, run.axis, sha256, gain)


def _table_response(stage: Stage, run: AxisRun) -> Samples:
    """Eq. 5 of Xu & Li 2010 over the scored rows, for the sine that drives the run."""
    table = stage.axis(run.axis).table
    if table is None:
        raise BadInput(
            f"stage {stage.name!r} has no table view for axis {run.axis}; "
            f"fit it to sines of several levels and frequencies, or {TIME_VIEW}"
        )
    sine = run.sine
    if sine is None or not sine.starts_at_zero:
        raise BadInput(f"{run.source}: the table view answers only a sine that starts at 0 V; {TIME_VIEW}")
    return table_response(table, run, sine.swing_V, sine.f_Hz)


def table_response(table: TableView, run: AxisRun, swing_V: float, f_Hz: float) -> Samples:
    """The table view's answer over the scored rows, in phase with the recorded voltage."""
    t = run.t_s[run.scored]
    turn = 2 * np.pi * f_Hz * (t - t[0])
    # u = mean - swing/2 cos(turn + phase): the phase tells where in its period the record starts.
    u = run.u_V[run.scored] - run.u_V[run.scored].mean()
    phase = float(np.arctan2(np.sum(u * np.sin(turn)), -np.sum(u * np.cos(turn))))
    return table.response(t - t[0] + phase / (2 * np.pi * f_Hz), _snap(swing_V, table.swing_V), f_Hz)


def _snap(value: float, edges: tuple[float, float]) -> float:
    """A converter gives 9.9997 V for 10 V: a swing within 0.5 % of the rectangle's edge is on it."""
    low, high = edges
    if low * 0.995 < value < low:
        return low
    return high if high < value < high * 1.005 else value
