"""Drive axes along paths, record, and judge: what `phaselead track` does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any, NamedTuple, Protocol, TypedDict, Unpack

import numpy as np

from phaselead.control.errors import tracking_error
from phaselead.control.feeding import point_feeder, refuse_endless, refuse_without_period
from phaselead.control.gains import check_loop
from phaselead.control.held import held_stage
from phaselead.control.joins import Span, enter_from_s, enter_s, quiet_s
from phaselead.control.modes import INVERTS, NEEDS_MODEL, USES_TABLES
from phaselead.control.motion_limits import refuse_too_fast, rests_unseen
from phaselead.control.path_begin import PathsToBegin, give
from phaselead.control.path_speed import refuse_path_too_fast
from phaselead.control.run import Run
from phaselead.control.triggers import set_pulses
from phaselead.control.true_position import TruePositions
from phaselead.device import (
    ALL_CHANNELS,
    TICK_HZ,
    Capture,
    Channel,
    Device,
    PointFeeder,
    Pulses,
    QueuedPaths,
    Refused,
    Standing,
    device_model,
    inverse_refusal,
    recording_of,
    standings,
    wire,
)
from phaselead.errors import BadInput, DeviceRefused
from phaselead.model import BACKWARDS, AxisModel, Gains, Stage, compensation, stage_text
from phaselead.record import Recording, Samples
from phaselead.sim import data_sheet
from phaselead.waveforms import POINTS, Curve, Goto, RepeatedAsSensed, Replaced, Rounded, Waveform, refuse_out_of_range

LEAST_SAID = {"um": 0.005, "V": 0.0005}
"""Of a difference between path and points: about a code of the converters."""
LAST_PERIODS, WHOLE_PATH, WHOLE_RECORD = "last four periods", "whole path", "whole record"
"""What the figures of a run are over."""
LONGEST_UNASKED_S = 6 * 3600.0
"""Nobody waits longer without having said so; a frequency in the wrong unit takes years."""


def default_duration_s(waveforms: Mapping[str, Waveform]) -> float:
    """Ten periods of the slowest path; a move and a second. Raises BadInput for more than anyone waits for unasked."""
    duration_s = max(waveform.default_duration_s for waveform in waveforms.values())
    if duration_s > LONGEST_UNASKED_S and any(waveform.periodic for waveform in waveforms.values()):
        raise BadInput(
            f"ten periods of this take {duration_s / 3600:.3g} hours: give a duration (--duration), or another "
            "frequency"
        )
    return duration_s


def ticks_of(duration_s: float) -> int:
    """A duration in ticks. Raises BadInput for less than one."""
    ticks = round(duration_s * TICK_HZ)
    if ticks < 1:
        raise BadInput(f"a duration of {duration_s:g} s is shorter than one tick of 0.2 ms; use a longer one")
    return ticks


def check_paths(waveforms: Mapping[str, Waveform], mode: str, stage: Stage | None) -> None:
    """Refuses, before anything moves, what the mode, the limits or the identified rectangle do not allow.

    Raises:
        BadInput: one line that says which axis, what is wrong and what would do.
    """
    for axis, waveform in waveforms.items():
        if mode == "open" and waveform.unit != "V":
            raise BadInput(f"{axis}: mode open takes volts, e.g. sine:5V@5Hz; for micrometres use pid, ff or ff+pid")
        if mode != "open" and waveform.unit == "V":
            raise BadInput(f"{axis}: volts need --mode open; mode {mode} takes micrometres, e.g. sine:60um@5Hz")
        if mode in NEEDS_MODEL and stage is None:
            raise BadInput(
                f"mode {mode} needs a model and the device holds none: --model STAGE.toml (`phaselead identify` makes "
                "one; `phaselead upload --persist` keeps it on the device); `phaselead track --mode pid` needs none"
            )
        check_path(axis, waveform, mode, stage.axis(axis) if stage is not None else AxisModel())


def check_path(axis: str, waveform: Waveform, mode: str, model: AxisModel) -> None:
    """Refuses a path outside the limits, the sensor's span, the identified rectangle or what the model can reach."""
    refuse_without_period(axis, waveform, mode)
    if mode in USES_TABLES and model.table is None:
        if inverse_refusal(model, axis) == BACKWARDS:
            raise BadInput(f"{axis}: mode {mode} needs a position that rises: {BACKWARDS}, or use mode open")
        other = _beyond_tables(axis, waveform, mode, model)
        raise BadInput(f"{axis}: mode {mode} needs the stage file's table view; identify it, {other}")
    try:
        refuse_out_of_range(waveform, model)
    except BadInput as error:
        raise BadInput(f"{axis}: {error}") from None
    refuse_path_too_fast(axis, waveform, model, mode)
    if mode in USES_TABLES:
        try:
            refuse_out_of_range(waveform, model, table=True)
        except BadInput as error:
            raise BadInput(f"{axis}: {error}, {_beyond_tables(axis, waveform, mode, model)}") from None
    if mode in INVERTS:
        _refuse_without_inverse(axis, waveform, mode, model)
    elif mode != "open" and inverse_refusal(model, axis) is None and rests_unseen(model) is None:
        _refuse_beyond_reach(axis, waveform, model)


def _beyond_tables(axis: str, waveform: Waveform, mode: str, model: AxisModel) -> str:
    """What follows a path that the tables do not cover: another mode where one can."""
    inverse = "inverse+pid" if mode.endswith("pid") else "inverse"
    try:
        _refuse_without_inverse(axis, waveform, inverse, model)
    except BadInput:
        return "or use --mode pid, which needs no tables"
    return f"or use --mode {inverse}, which needs no tables"


def _refuse_without_inverse(axis: str, waveform: Waveform, mode: str, model: AxisModel) -> None:
    reason = inverse_refusal(model, axis)
    if reason is not None:
        other = ", or use mode open" if reason == BACKWARDS else "; or use mode pid"
        raise BadInput(f"{axis}: mode {mode} needs an inverse of the model: {reason}{other}")
    _refuse_beyond_reach(axis, waveform, model)


def _refuse_beyond_reach(axis: str, waveform: Waveform, model: AxisModel) -> None:
    low_um, high_um = compensation(model).reach_um
    if not low_um <= waveform.lowest <= waveform.highest <= high_um:
        raise BadInput(
            f"{axis}: {waveform.lowest:g}..{waveform.highest:g} um is outside what the model can reach whatever the "
            f"stage did before ({low_um:.4g}..{high_um:.4g} um); choose a smaller swing or another offset"
        )


class Asked(TypedDict, total=False):
    """What a run may be asked for beside its paths and its mode."""

    stage: Stage | None
    """The model, uploaded when the device holds another."""
    gains: Mapping[str, Gains] | None
    """By axis, for modes with pid."""
    duration_s: float | None
    force: bool
    """Takes the gains whatever the model says."""
    edge_within_s: float | None
    """The paths begin at an edge of the trigger input, which is waited for so long."""


class MakesWay(Protocol):
    """Axes that are held, or follow paths: what has them make way for others."""

    @property
    def axes(self) -> str:
        """Letters of all of them."""

    def way_for(self, waveforms: Mapping[str, Waveform]) -> AbstractContextManager[Mapping[str, Span]]:
        """While the paths are begun and run: where each axis may be when its path is queued. Where they are refused,
        axes that made way hold and the others go on as they did."""


def track(
    device: Device,
    waveforms: Mapping[str, Waveform],
    mode: str,
    *,
    on_progress: Callable[[float], None] | None = None,
    sink: Callable[[bytes], None] | None = None,
    pulses: Sequence[Pulses] | None = None,
    park: bool = True,
    going_on: MakesWay | None = None,
    **asked: Unpack[Asked],
) -> Run:
    """Runs the paths of all axes together from the same tick. Each is entered from where its axis stands before it
    begins, and left where it ends, without a kick. In the end the device is parked or, if not ``park``, holds there.

    ``asked``: see there. ``on_progress`` is given the fraction done; ``sink`` every chunk as it came off the line, for
    a journal. ``pulses``: what the trigger outputs do. ``going_on``: the axes are held, or follow paths, and go on from
    there.

    Raises:
        BadInput: a path that the mode, the limits or the model do not allow, or gains that the model's loop cannot
            stand; nothing has moved.
        DeviceFault: the device latched a fault on the way; its ``capture`` holds what was recorded.
    """
    with nullcontext() if going_on is None else going_on.way_for(waveforms) as spans_um:
        try:
            ready = set_up(device, waveforms, mode, spans_um=spans_um, **asked)
        except Refused as refusal:
            if refusal.status != wire.Status.WRONG_STATE or going_on is not None:
                raise
            raise DeviceRefused(
                "the axes are held or driven, and this begins at rest; `phaselead park` (in Python dev.park()) ends "
                "that"
            ) from None
        beside = "" if going_on is None else going_on.axes
        return _run(device, ready, mode, asked.get("stage"), beside, on_progress, sink, pulses, park=park)


def _run(
    device: Device,
    ready: SetUp,
    mode: str,
    stage: Stage | None,
    beside: str,
    on_progress: Callable[[float], None] | None,
    sink: Callable[[bytes], None] | None,
    pulses: Sequence[Pulses] | None,
    *,
    park: bool,
) -> Run:
    """``beside``: axes that are driven too, and whose codes a replay needs."""
    waveforms, ticks = ready.waveforms, ready.ticks
    axes = "".join(sorted(set(waveforms) | set(beside)))
    set_pulses(device, pulses, stage or held_stage(device, "".join(waveforms)) if pulses else None)
    true = TruePositions(device, ticks)
    capture = device.capture(
        ticks,
        axes=axes,
        channels=channels_of_run(len(axes), pulses),
        park=park,
        lead_ticks=ready.lead_ticks,
        tail_ticks=ready.tail_ticks,
        queued=ready.queued,
        progress=None if on_progress is None else lambda done: on_progress(done / ticks),
        sink=sink,
        feeder=ready.feeder,
    )
    recording = run_recording(capture, mode, stage, pulses, axes="".join(waveforms))
    true_um = true.of(recording, capture)
    figures, judged_by = run_figures(recording, capture, waveforms, mode, true_um), meant_um(recording, waveforms)
    run = Run(recording, capture, figures, true_um, meant_um=judged_by)
    return run.with_pulses(pulses or ())


def channels_of_run(axes: int, pulses: Sequence[Pulses] | None) -> int:
    """What is streamed of so many axes: all, and what the triggers do where they are in use. Three axes with all of it
    are more than the line carries; a replay does without the feedback's volts, which are worked out anew."""
    if not pulses:
        return ALL_CHANNELS
    return ALL_CHANNELS + Channel.TRIGGER - (Channel.FEEDBACK if axes > 2 else 0)


class SetUp(NamedTuple):
    """A device that has its paths: what is captured of them."""

    waveforms: dict[str, Waveform]
    """As they begin where the axes stand."""
    ticks: int
    lead_ticks: int
    """Of the way into the paths that belongs to the record."""
    tail_ticks: int
    """Of the way out of them."""
    feeder: PointFeeder | None = None
    """Sends the points of paths that are longer than the device's memory."""
    queued: QueuedPaths | None = None
    """What begins the paths, if it is not the start."""

    def begin(self, device: Device) -> int:
        """Begins them, and leaves them running: the tick in which they do. Raises Refused where they are refused."""
        if self.queued is not None:
            return self.queued.first_tick(device.session.request(self.queued.queue).tick)
        if device.status().state == "parked":
            device.arm()
        return device.start("".join(sorted(self.waveforms)))


def set_up(
    device: Device,
    waveforms: Mapping[str, Waveform],
    mode: str,
    *,
    stage: Stage | None = None,
    gains: Mapping[str, Gains] | None = None,
    duration_s: float | None = None,
    endless: bool = False,
    force: bool = False,
    edge_within_s: float | None = None,
    spans_um: Mapping[str, Span] | None = None,
) -> SetUp:
    """Gives the device its paths; periodic ones go on until told otherwise where they are ``endless``, and begin at an
    edge of the trigger input where that is waited for. ``spans_um``: the axes are held, or follow paths, and where each
    may be then. Raises BadInput as ``track``."""
    known = stage or held_stage(device, "" if mode in NEEDS_MODEL else "".join(waveforms))
    check_paths(waveforms, mode, known)
    if endless:
        refuse_endless(waveforms)
    loop_warnings(stage, mode, gains or {}, force=force)
    if stage is not None and spans_um is None:
        device.upload_if_other(device_model(stage))
    seconds = duration_s if duration_s is not None else default_duration_s(waveforms)
    ticks = ticks_of(seconds)
    standing = dict(standings(device))
    for axis, span in (spans_um or {}).items():
        standing[axis] = replace(standing[axis], x_um=span[0])
    waveforms = {axis: from_standing(axis, waveform, standing[axis], known) for axis, waveform in waveforms.items()}
    entered_s, left_s = {}, {}
    for axis, waveform in waveforms.items():
        model = None if known is None else known.axes.get(axis)
        entered_s[axis] = (
            enter_s(waveform, standing[axis], mode, model)
            if spans_um is None
            else enter_from_s(waveform, spans_um[axis], mode, model)
        )
        left_s[axis] = quiet_s(model)
        if edge_within_s is not None or spans_um is not None:  # nothing begins at once out of a hold
            entered_s[axis] = max(entered_s[axis], left_s[axis])
    if edge_within_s is not None or spans_um is not None:  # all are entered in the same time, to begin together
        entered_s = dict.fromkeys(entered_s, max(entered_s.values()))
        left_s = dict.fromkeys(left_s, max(left_s.values()))
    lead_ticks = min(round(max(entered_s.values()) * TICK_HZ), ticks - 1) if mode == "open" else 0
    feeder = None if endless else point_feeder(device, waveforms, ticks - lead_ticks, entered_s, left_s)
    if feeder is not None:
        feeder.begin()
    tail_ticks = round(2 * max(left_s.values()) * TICK_HZ)
    length = 0 if endless else ticks - lead_ticks
    paths = PathsToBegin(waveforms, mode, gains or {}, length, entered_s, left_s, feeder)
    queued = give(device, paths, held=spans_um is not None, edge_within_s=edge_within_s)
    return SetUp(dict(waveforms), ticks, lead_ticks, tail_ticks, feeder, queued)


def loop_warnings(stage: Stage | None, mode: str, gains: Mapping[str, Gains], *, force: bool = False) -> list[str]:
    """What the model says against the gains of a run, by axis; nothing without feedback, or without a model.

    Raises BadInput for a loop that the model cannot stand, unless ``force``.
    """
    if stage is None or not mode.endswith("pid"):
        return []
    known = ((axis, stage.axes[axis], own) for axis, own in gains.items() if axis in stage.axes)
    found = (check_loop(axis, model, own, force=force) for axis, model, own in known)
    return [line for line in found if line is not None]


def run_recording(
    capture: Capture,
    mode: str,
    stage: Stage | None,
    pulses: Sequence[Pulses] | None = None,
    *,
    axes: str | None = None,
) -> Recording:
    """The capture of a run in units, with the stage file it was driven by, and the names of its trigger outputs.
    ``axes``: of these alone; None: of all that were captured."""
    closed = frozenset(capture.axes) if mode != "open" else frozenset[str]()
    meta: dict[str, Any] = {"mode": mode, "stage": stage_text(stage) if stage is not None else ""}
    named = {"trigger_out": [one.name for one in pulses]} if pulses else {}
    return recording_of(capture, axes=axes, closed_loop=closed, meta=meta | named)


def assumed_limits(device: Device) -> str | None:
    """What to warn of when a device holds no model: the figures it then assumes. None for the built-in stage, whose
    own they are."""
    if data_sheet(device.session.name) is not None or device.read_model() is not None:
        return None
    sensor, actuator, limits = AxisModel().sensor, AxisModel().actuator, AxisModel().limits
    return (
        f"the device holds no model: assuming a sensor of {sensor.x_min_um:g}..{sensor.x_max_um:g} um, converters of "
        f"{actuator.u_min_V:g}..{actuator.u_max_V:g} V and limits of {limits.u_min_V:g}..{limits.u_max_V:g} V; "
        "give your stage's with --model"
    )


def path_warnings(waveforms: Mapping[str, Waveform]) -> list[str]:
    """By how much the device leaves the path that was asked for, by axis."""
    return [
        f"{axis}: {_left(waveform)}"
        for axis, waveform in waveforms.items()
        if waveform.unplayed > LEAST_SAID[waveform.unit]
    ]


def _left(waveform: Waveform) -> str:
    judged = ", which counts as error" if waveform.unit == "um" else ""  # volts are what is recorded
    by = f"left by up to {waveform.unplayed:.3g} {waveform.unit}{judged}"
    if isinstance(waveform, Replaced | RepeatedAsSensed | Rounded) and waveform.rounding_s > 0:
        return (
            f"the output is too slow for its corners, which are rounded over {2e3 * waveform.rounding_s:.2g} ms: the "
            f"path is {by}; those of a smaller or slower path are sharper"
        )
    if isinstance(waveform.as_asked, Curve):
        return (
            f"the device plays {POINTS} points a period: the path is {by}; a file of it is streamed (path:) and nearer"
        )
    return (
        f"the device plays {_how_fine(waveform)}: the file is {by}; take out of the file what is so "
        f"fast{_or_else(waveform)}"
    )


def _how_fine(waveform: Waveform) -> str:
    return "at most a point a tick" if waveform.played_as == "points" else f"{POINTS} points a period"


def _or_else(waveform: Waveform) -> str:
    return "" if waveform.played_as == "points" else ", or let `track` stream it: path: instead of file:"


def from_standing(axis: str, waveform: Waveform, standing: Standing, stage: Stage | None) -> Waveform:
    """A move begun where the axis stands; a periodic path as it is.

    Raises BadInput for a move that cannot be as short as it was asked to be.
    """
    waveform = waveform.from_start(standing.u_V if waveform.unit == "V" else standing.x_um)
    if isinstance(waveform, Goto) and waveform.asked and waveform.unit == "um":
        refuse_too_fast(axis, waveform.swing, waveform.duration_s, None if stage is None else stage.axes.get(axis))
    return waveform


def run_figures(
    recording: Recording,
    capture: Capture,
    waveforms: Mapping[str, Waveform],
    mode: str,
    true_um: Mapping[str, Samples] | None = None,
) -> dict[str, Any]:
    """Figures of a run: flat for one axis, under "axes" for several."""
    common = {"mode": mode, "ticks": len(recording.t_s), "dropped": capture.missing}
    per_axis = {
        axis: axis_figures(recording, axis, waveform, mode, (true_um or {}).get(axis))
        for axis, waveform in waveforms.items()
    }
    if len(per_axis) == 1:
        return common | next(iter(per_axis.values()))
    return common | {"axes": per_axis}


def meant_um(recording: Recording, waveforms: Mapping[str, Waveform]) -> dict[str, Samples]:
    """The path that each axis in closed loop is judged by, shape (n,)."""
    found = {}
    for axis, waveform in waveforms.items():
        r_um = recording.axes[axis].r_um
        if r_um is not None:
            found[axis] = waveform.value(recording.t_s) if waveform.judged_apart else r_um
    return found


def axis_figures(
    recording: Recording, axis: str, waveform: Waveform, mode: str, true_um: Samples | None = None
) -> dict[str, Any]:
    """Error over the last four periods (what is driven once: all of it), and from rest: over every sample.

    Judged is the path that was asked for, also where the device plays it in points; where the true position follows
    it, as a sensor with the lag of the model's (``sensor_lag_s``) would show it. ``true``: the path against where a
    virtual stage truly is. In mode open there is no reference: the error figures are null and the measured range
    stands beside them. The join into the path is no part of it.
    """
    record = recording.axes[axis]
    assert record.x_um is not None
    if record.r_um is None:
        names = ("max_um", "rms_um", "range_um", "max_pct", "max_um_mean_removed")
        nothing: dict[str, Any] = dict.fromkeys(names)
        return nothing | {"measured_range_um": float(np.ptp(record.x_um)), "from_rest": dict(nothing)}
    judged = waveform.judged_rows(len(record.x_um), TICK_HZ)
    meant = meant_um(recording, {axis: waveform})[axis]
    asked = waveform.as_asked
    asked_um = meant if asked is waveform else asked.value(recording.t_s)
    steady = tracking_error(meant[judged], record.x_um[judged], asked_um[judged])
    whole = tracking_error(meant, record.x_um, asked_um)
    part_of_it = LAST_PERIODS if waveform.periodic else WHOLE_PATH
    part = {"judged": part_of_it if len(meant[judged]) < len(meant) else WHOLE_RECORD}
    unplayed = {"unplayed_um": waveform.unplayed} if waveform.unplayed > LEAST_SAID["um"] else {}
    lag_s = waveform.lag_s if isinstance(waveform, Replaced | RepeatedAsSensed) else 0.0
    lag = {"sensor_lag_s": lag_s} if lag_s > 0 else {}
    true = {} if true_um is None else {"true": _true_figures(recording.t_s, true_um, waveform, record.r_um)}
    return steady.as_dict() | part | unplayed | lag | {"from_rest": whole.as_dict()} | true


def _true_figures(t_s: Samples, true_um: Samples, waveform: Waveform, r_um: Samples) -> dict[str, Any]:
    """The path as the user wrote it against the true position (n,)."""
    asked = waveform.as_asked
    asked_um = asked.value(t_s) if asked.periodic or asked.judged_apart else r_um
    judged = waveform.judged_rows(len(true_um), TICK_HZ)
    return tracking_error(asked_um[judged], true_um[judged]).as_dict() | {
        "from_rest": tracking_error(asked_um, true_um).as_dict()
    }
