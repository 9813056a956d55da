"""Judging a stage file on recordings: prediction against measurement, nothing refitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from phaselead.errors import BadInput
from phaselead.identify.runs import FEWEST_ROWS, AxisRun, driven_runs
from phaselead.model import Stage, TableView, predict
from phaselead.record import Recording, Samples, slow_gain

View = Literal["time", "table"]
CLEARLY_BETTER = 2.0
"""Times less rms, in the rows in which two predictions differ. Chosen: a quarter of the power."""
TURNS_TRIED = 33
"""Voltages over the range of the model at which a stage may have turned round before a record that begins at 0 V."""
BEST_OF_MANY = 4.0
"""What ``CLEARLY_BETTER`` is for the best of so many. Chosen: one of them is better by chance."""
ALIKE = 1.01
"""Times the rms of the best by which turns leave the same: beyond twice the largest threshold all do."""
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
    about_start: str = ""
    """What to say where the record is judged from rest at 0 V and probably began elsewhere."""


def verification_dict(verification: Verification) -> dict[str, Any]:
    """As it goes into JSON."""
    figures = asdict(verification)
    del (
        figures["sha256"],
        figures["gain"],
        figures["about_start"],
    )  # of the page and of doubts; a reader of the JSON has the file
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
                found.append(_judge(run, _table_response(stage, run), refit_offset, sha256))
                continue
            stage.axis(axis)
            x_um = _position(predicted, axis)
            about = _about_start(stage, recording, run, x_um, refit_offset)
            found.append(replace(_judge(run, x_um[run.scored], refit_offset, sha256), about_start=about))
    return found


def _position(predicted: Recording | None, axis: str) -> Samples:
    x_um = None if predicted is None else predicted.axes[axis].x_um
    assert x_um is not None
    return x_um


def _about_start(stage: Stage, recording: Recording, run: AxisRun, rested_um: Samples, refit_offset: bool) -> str:
    """What to say of a run that is described clearly better from elsewhere than from rest at 0 V (``rested_um``, (n,)).
    Nothing where the two say the same."""

    def left_um(turned_V: tuple[float, ...]) -> Samples:
        predicted = predict(stage, recording, turned_V={run.axis: turned_V})
        return (run.x_um - _position(predicted, run.axis))[run.scored]

    rested = (run.x_um - rested_um)[run.scored]
    tried = {turned_V: left_um(turned_V) for turned_V in _ways(stage, run, rested)}
    if not tried:
        return ""
    least_um = min(float(np.std(left)) for left in tried.values())
    alike = [turned_V for turned_V, left in tried.items() if float(np.std(left)) <= ALIKE * least_um]
    way = min(alike, key=lambda turned_V: [abs(volt) for volt in turned_V])
    elsewhere = tried[way]
    # Rows in which the two differ by less than the better one is off anyway tell nothing.
    differ = np.flatnonzero(np.abs(rested - elsewhere) > np.std(elsewhere))
    offset_um = elsewhere.mean() if refit_offset else 0.0
    both = (rested, elsewhere)
    rms_um = [float(np.sqrt(np.mean((e[differ] - offset_um) ** 2))) if differ.size else 0.0 for e in both]
    if rms_um[0] <= (BEST_OF_MANY if way else CLEARLY_BETTER) * rms_um[1]:
        return ""
    at = f"{run.source}: axis {run.axis} begins at {run.u_V[0]:.3g} V"
    if way:
        said = (
            f"{at}, which counts as at rest: that leaves {rms_um[0]:.3g} um rms where it matters, {rms_um[1]:.3g} if "
            f"the stage had come from about {way[0]:.3g} V{' or further' if len(alike) > 1 else ''}. If it had, "
        )
    else:
        said = (
            f"{at}, which counts as a step from rest at 0 V: it leaves {rms_um[0]:.3g} um rms where that matters, "
            f"{rms_um[1]:.3g} if the stage had long stood there. If it had, "
        )
    t_s = run.t_s[run.scored]
    if len(t_s) - (differ[-1] + 1) < FEWEST_ROWS:
        first = "drive a full loop first" if way else "record it with the way from 0 V"
        return said + f"that matters to the end: {first}, and score what comes after"
    decimals = max(0, math.ceil(-math.log10(run.step_s))) + 1
    return said + f"score only what comes after, with the window @{t_s[differ[-1] + 1]:.{decimals}f}:"


def _ways(stage: Stage, run: AxisRun, rested: Samples) -> list[tuple[float, ...]]:
    """Where the stage may have turned round before the run, to try: straight to its first voltage, or at 0 V, where the
    first half is clearly worse than the second, at some voltage of the model's range."""
    if not run.begins_at_0_V:
        return [()]
    view, half = stage.axis(run.axis).time, len(rested) // 2
    usual_um = float(np.mean(rested[half:]))
    first, second = (float(np.sqrt(np.mean((e - usual_um) ** 2))) for e in (rested[:half], rested[half:]))
    if view is None or first <= CLEARLY_BETTER * second:
        return []
    return [(float(turned_V),) for turned_V in np.linspace(*view.u_range_V, TURNS_TRIED)]


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
