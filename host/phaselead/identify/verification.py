"""Judging a stage file on recordings: prediction against measurement, nothing refitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from phaselead.errors import BadInput
from phaselead.identify.runs import FEWEST_ROWS, AxisRun, driven_runs
from phaselead.identify.simple_changes import Described, described, more_than_usual
from phaselead.model import Stage, TableView, TimeView, in_other_times, out_of_scale, predict
from phaselead.record import Recording, Samples, slow_gain

View = Literal["time", "table"]
FIGURES = ("file", "max_um", "mean_um", "range_um", "max_pct", "mean_pct")
CLEARLY_BETTER = 2.0
"""Times less rms, in the rows in which two predictions differ. Chosen: a quarter of the power."""
TURNS_TRIED = 33
"""Voltages over the range of the model at which a stage may have turned round before a record."""
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
    described: Described | None = None
    """What describes an error that is larger than the model should leave."""
    fitted_on: bool = False
    """Whether the stage file says that the model was fitted on rows of it."""


def verification_dict(verification: Verification) -> dict[str, Any]:
    """As it goes into JSON."""
    figures = {name: getattr(verification, name) for name in FIGURES}
    if verification.axis != "x":  # the plain form of a one-axis recording is without
        figures["axis"] = verification.axis
    if verification.described is not None:
        figures["error_um_rms"] = verification.described.error_um_rms
        figures["fitted_um_rms"] = verification.described.fitted_um_rms
        figures["described_by"] = [asdict(one) for one in verification.described.ways]
    if verification.about_start:
        figures["about_start"] = verification.about_start
    if verification.fitted_on:
        figures["fitted_on"] = True
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
        fitted_on = stage.provenance.holds_rows_of(recording)
        for axis, run in runs.items():
            if predicted is None:
                judged = _judge(run, _table_response(stage, run), refit_offset, sha256)
                found.append(replace(judged, fitted_on=fitted_on))
                continue
            stage.axis(axis)
            x_um = _position(predicted, axis)
            judged = _judge(run, x_um[run.scored], refit_offset, sha256)
            about = _about_start(stage, recording, run, x_um, refit_offset)
            changes = None if about else _described(stage, recording, run, judged, x_um, refit_offset)
            found.append(replace(judged, about_start=about, described=changes, fitted_on=fitted_on))
    return found


def _position(predicted: Recording | None, axis: str) -> Samples:
    x_um = None if predicted is None else predicted.axes[axis].x_um
    assert x_um is not None
    return x_um


def _described(
    stage: Stage, recording: Recording, run: AxisRun, judged: Verification, x_um: Samples, refit_offset: bool
) -> Described | None:
    """What describes the error of a record that moves as one of the stage may; None of another, or in other times."""
    view = stage.axis(run.axis).time
    if view is None or out_of_scale(judged.gain) or in_other_times(stage, [recording]):
        return None

    def at_rest_um() -> Samples:
        still = {
            name: replace(axis, u_V=None if axis.u_V is None else np.zeros_like(axis.u_V))
            for name, axis in recording.axes.items()
        }
        return _position(predict(stage, replace(recording, axes=still)), run.axis)

    return described(run, view, x_um, at_rest_um, refit_offset=refit_offset, follows=judged.gain is not None)


def _about_start(stage: Stage, recording: Recording, run: AxisRun, rested_um: Samples, refit_offset: bool) -> str:
    """What to say of a run that is described clearly better from elsewhere than from rest at 0 V (``rested_um``, (n,)).
    Nothing where the two say the same."""

    def left_um(turned_V: tuple[float, ...]) -> Samples:
        predicted = predict(stage, recording, turned_V={run.axis: turned_V})
        return (run.x_um - _position(predicted, run.axis))[run.scored]

    def rms(error_um: Samples) -> float:
        return float(np.std(error_um) if refit_offset else np.sqrt(np.mean(error_um**2)))

    view, rested = stage.axis(run.axis).time, (run.x_um - rested_um)[run.scored]
    if view is None or not more_than_usual(rms(rested), run, view):
        return ""
    tried = {turned_V: left_um(turned_V) for turned_V in _ways(view, run, rested)}
    if not tried:
        return ""
    rms_um = {way: rms(error_um) for way, error_um in tried.items()}
    alike = [way for way, left_um in rms_um.items() if left_um <= ALIKE * min(rms_um.values())]
    best = min(alike, key=lambda turned_V: [abs(volt) for volt in turned_V])
    stood = [()] if () in tried else []
    ways = [*stood, best] if stood and rms_um[()] <= CLEARLY_BETTER * rms_um[best] else [best, *stood]
    for way in dict.fromkeys(ways):
        said = _begun_elsewhere(run, rested, tried[way], way, len(alike) > 1, refit_offset)
        if said:
            return said
    return ""


def _begun_elsewhere(
    run: AxisRun, rested: Samples, elsewhere: Samples, way: tuple[float, ...], or_further: bool, refit_offset: bool
) -> str:
    """What to say where a run is described clearly better after such turns (``elsewhere``, (n,) in um) than from rest
    at 0 V; ``or_further``: by others too."""
    # Rows in which the two differ by less than the better one is off anyway tell nothing.
    differ = np.flatnonzero(np.abs(rested - elsewhere) > np.std(elsewhere))
    offset_um = elsewhere.mean() if refit_offset else 0.0
    both = (rested, elsewhere)
    rms_um = [float(np.sqrt(np.mean((e[differ] - offset_um) ** 2))) if differ.size else 0.0 for e in both]
    if rms_um[0] <= (BEST_OF_MANY if way else CLEARLY_BETTER) * rms_um[1]:
        return ""
    taken = "at rest" if run.begins_at_0_V else "a step from rest at 0 V"
    came = f"had come from about {way[0]:.3g} V{' or further' if or_further else ''}" if way else "had long stood there"
    said = (
        f"{run.source}: axis {run.axis} begins at {run.u_V[0]:.3g} V, which counts as {taken}: that leaves "
        f"{rms_um[0]:.3g} um rms where it matters, {rms_um[1]:.3g} if the stage {came}. If it had, "
    )
    t_s = run.t_s[run.scored]
    if len(t_s) - (differ[-1] + 1) < FEWEST_ROWS:
        first = "drive a full loop first" if way else "record it with the way from 0 V"
        return said + f"that matters to the end: {first}, and score what comes after"
    decimals = max(0, math.ceil(-math.log10(run.step_s))) + 1
    return said + f"score only what comes after, with the window @{t_s[differ[-1] + 1]:.{decimals}f}:"


def _ways(view: TimeView, run: AxisRun, rested: Samples) -> list[tuple[float, ...]]:
    """Where the stage may have turned round before the run, to try: at some voltage of the model's range, and before a
    run that begins elsewhere than at 0 V nowhere. A run from 0 V must be clearly worse in its first half than in its
    second."""
    half = len(rested) // 2
    usual_um = float(np.mean(rested[half:]))
    first, second = (float(np.sqrt(np.mean((e - usual_um) ** 2))) for e in (rested[:half], rested[half:]))
    if run.begins_at_0_V and first <= CLEARLY_BETTER * second:
        return []
    turns: list[tuple[float, ...]] = [(float(turned_V),) for turned_V in np.linspace(*view.u_range_V, TURNS_TRIED)]
    return turns if run.begins_at_0_V else [(), *turns]


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
