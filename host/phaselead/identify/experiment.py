"""The identification experiment: which sines in which order, run on a device, then fitted and verified.

This is what `phaselead identify` does.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from phaselead.device import (
    LARGEST_STEP_V,
    TICK_HZ,
    Capture,
    Channel,
    Device,
    Mode,
    after_interrupt,
    device_model,
    from_device_model,
    recording_of,
    standings,
)
from phaselead.errors import BadInput
from phaselead.identify import held_creep
from phaselead.identify.fit_result import FitResult
from phaselead.identify.fitting import FitReport, fit
from phaselead.identify.kept import Kept
from phaselead.identify.plan import AROUND_S, HELD_S, WAIT_S, Experiment, name_of_hold, plan_grid, plan_seconds
from phaselead.identify.verification import Verification, View, verify
from phaselead.identify.verifications import Verifications
from phaselead.model import AxisModel, Stage, provenance_of
from phaselead.record import AXES, Recording, Samples, refuse_gapped
from phaselead.sim import data_sheet
from phaselead.waveforms import Goto, Sine, refuse_out_of_range

LATE_S = 1.0
"""A pause that is longer than planned by more than this was not one within a session."""
CHANNELS = Channel.ADC | Channel.DAC
FIT_SHARE = 0.1
"""Of the progress bar, for what comes after the last record."""


@dataclass
class Progress:
    """The share that is done, for whoever wants to know."""

    driven_s: float
    """In all."""
    on_progress: Callable[[float], None] | None
    done_s: float = 0.0

    def add(self, seconds: float) -> None:
        self.done_s += seconds
        if self.on_progress is not None:
            self.on_progress(self.done_s / self.driven_s * (1 - FIT_SHARE))


@dataclass(frozen=True)
class Identified:
    """A stage, how it was fitted, and how it does on the held-out records of the same session."""

    stage: Stage
    report: FitReport
    verifications: dict[View, list[Verification]]
    recordings: list[Recording]
    held_out: list[Recording]
    holds: dict[str, Recording]
    """Of the axes whose creep was measured."""

    def as_fit(self) -> FitResult:
        """The result as people see it."""
        held_out = {view: Verifications(found, view, self.stage.name) for view, found in self.verifications.items()}
        return FitResult(self.stage, self.report, self.recordings, held_out, self.holds)


def identify_device(
    device: Device,
    axes: Sequence[str] = ("x",),
    on_progress: Callable[[float], None] | None = None,
    *,
    plan: Sequence[Experiment] | None = None,
    kept: Kept | None = None,
    stage: Stage | None = None,
    creep: bool = True,
) -> Identified:
    """Run the plan (default: the paper's grid on ``axes``), fit both views, and verify on what was held out.

    One axis is recorded alone; for several, all three are recorded while each is driven, which gives the
    cross-coupling. The held-out records of the table view are judged whole; those of the time view from
    their second period on, because in a session no record but the first starts from rest. ``kept`` keeps every record
    of the plan as soon as it is there, and has those of a session that was cut short. Limits and calibration are those
    of ``stage``, which is uploaded first, else of the model that the device holds, else a built-in stage's own,
    else the defaults; they go on into what is identified. ``creep``: at the end each axis also holds 5 V, or the
    largest level of the plan if that is less, for 12 s, after 40 s of rest; its creep is an effect of the model, and
    the time view is fitted to what the sines show without it.

    Raises:
        BadInput: the plan leaves the device's limits (nothing has moved), a record is gapped or the fit impossible.
    """
    chosen = list(plan) if plan is not None else plan_grid(axes)
    held_axes = tuple(axes) if creep else ()
    parent, parent_sha256 = (stage, stage.sha256) if stage is not None else held_by(device)
    upload = stage
    if parent is None and (sheet := data_sheet(device.session.name)) is not None:
        parent = sheet.model_copy(update={"name": "identified"})
        upload = None if is_assumed(parent) else parent
    refuse_beyond_limits(chosen, parent)
    if upload is not None:
        device.upload_if_other(device_model(upload))
    refuse_away_from_zero(device)
    resumed = kept is not None and kept.is_resumed(chosen, held_axes)
    waits_s = WAIT_S if resumed and creep else 0.0
    progress = Progress(plan_seconds(chosen, held_axes) + waits_s, on_progress)
    try:
        taken = _taken(device, chosen, len(set(axes)) == 1, kept, progress, waits_s)
        holds = {
            axis: _hold(device, axis, held_creep.hold_of(chosen, axis, slew_V_per_s(parent, axis)), kept, progress)
            for axis in held_axes
        }
    except KeyboardInterrupt as ended:
        ended.args = (after_interrupt(device.session),)
        raise
    records = [one.recording for one in taken]
    used = [r for r, e in zip(records, chosen, strict=True) if not e.held_out]
    held_out = [r for r, e in zip(records, chosen, strict=True) if e.held_out]
    k = {axis: held_creep.creep_of(record, axis) for axis, record in holds.items()}
    less = _without_creep(chosen, taken, k)
    found, report = fit(used, name="identified", parent=parent, without=lambda r: less[r.source], creep=False)
    for axis in k:
        found = _with_creep(found, axis, k[axis], report)
    held = provenance_of(None, list(holds.values())).data
    origin = {"parent_sha256": parent_sha256, "data": (*found.provenance.data, *held)}
    found = found.model_copy(update={"provenance": found.provenance.model_copy(update=origin)})
    apart = [after_first_period(r, e) for r, e in _held_out(chosen, held_out)]
    verifications: dict[View, list[Verification]] = {"time": verify(found, apart, "time")}
    if all(found.axis(e.axis).table is not None for e in chosen):
        verifications["table"] = _by_table(found, held_out, report)
    return Identified(found, report, verifications, used, held_out, holds)


@dataclass(frozen=True)
class Taken:
    """A record of the plan, and which ticks of which session it is."""

    recording: Recording
    session: int
    begin_tick: int
    end_tick: int

    def rested_s(self, before: Taken, planned_s: float) -> float | None:
        """Since the end of the record before; None where it was not taken right after that one, as planned."""
        pause_s = (self.begin_tick - before.end_tick) / TICK_HZ
        return pause_s if self.session == before.session and 0 <= pause_s <= planned_s + LATE_S else None


def _taken(
    device: Device,
    plan: Sequence[Experiment],
    alone: bool,
    kept: Kept | None,
    progress: Progress,
    waits_s: float,
) -> list[Taken]:
    """Every experiment of the plan, run now or found among what was kept; before the first that is run after one that
    was found it waits."""
    records: list[Taken] = []
    for experiment in plan:
        capture = kept.found(experiment.name, device) if kept is not None else None
        known = capture is not None
        if capture is None:
            if waits_s:
                device.wait(waits_s)
                progress.add(waits_s)
                waits_s = 0.0
            capture = run_experiment(device, experiment, alone=alone)[0]
        recording = recording_of_experiment(capture, experiment)
        if kept is not None and not known:
            kept.add(capture, recording)
        records.append(Taken(recording, capture.session, capture.recorded_from, capture.end_tick))
        progress.add(experiment.seconds + AROUND_S)
    return records


def _hold(device: Device, axis: str, move: Goto, kept: Kept | None, progress: Progress) -> Recording:
    """The record that shows how an axis creeps, run now or found."""
    capture = kept.found(name_of_hold(axis), device) if kept is not None else None
    known = capture is not None
    if capture is None:
        device.wait(WAIT_S)
        capture = held_creep.hold(device, axis, move)
    recording = held_creep.recording_of_hold(capture, axis)
    if kept is not None and not known:
        kept.add(capture, recording)
    progress.add(HELD_S)
    return recording


def _without_creep(
    plan: Sequence[Experiment], taken: Sequence[Taken], k: Mapping[str, Samples]
) -> dict[str, Recording]:
    """Every record of the plan without what creeps in it, by its source."""
    less = {one.recording.source: one.recording for one in taken}
    for axis, shares in k.items():
        mine = [(one, e) for one, e in zip(taken, plan, strict=True) if e.axis == axis]
        pauses = [one.rested_s(before, e.rest_s) for (before, _), (one, e) in itertools.pairwise(mine)]
        records = [one.recording for one, _ in mine]
        less |= {r.source: r for r in held_creep.without_creep(records, axis, shares, [None, *pauses])}
    return less


def _with_creep(stage: Stage, axis: str, k: Samples, report: FitReport) -> Stage:
    """The stage with this creep as an effect, where there is any; the report says so."""
    if not k.any():
        report.messages.append(f"axis {axis}: no creep seen while it is held")
        return stage
    report.messages.append(f"axis {axis}: {held_creep.described_creep(k)}; adopted as effect creep")
    model = stage.axis(axis)
    model = model.model_copy(update={"effects": (*model.effects, held_creep.effect_of_hold(k))})
    return stage.model_copy(update={"axes": {**stage.axes, axis: model}})


def is_assumed(sheet: Stage) -> bool:
    """Whether limits and calibration are those that a device without a model assumes."""
    assumed = sheet.model_copy(update={"axes": {axis: AxisModel() for axis in AXES}})
    return from_device_model(device_model(sheet)).axes == from_device_model(device_model(assumed)).axes


def held_by(device: Device) -> tuple[Stage | None, str | None]:
    """Limits and calibration of the model the device holds, and the hash of the stage file it was made of."""
    blob = device.read_model()
    if blob is None:
        return None, None
    held = from_device_model(blob)
    return Stage(name="identified", axes=held.axes), held.stage_sha256


def slew_V_per_s(parent: Stage | None, axis: str) -> float:
    """That the limits of an axis allow."""
    return _model_of(parent, axis).limits.slew_V_per_s


def _model_of(parent: Stage | None, axis: str) -> AxisModel:
    return parent.axes.get(axis, AxisModel()) if parent is not None else AxisModel()


def refuse_beyond_limits(plan: Sequence[Experiment], parent: Stage | None) -> None:
    """Raises BadInput for the largest level of the plan that the limits (without a parent: the defaults) leave out."""
    for e in sorted(plan, key=lambda e: -e.swing_V):
        model = _model_of(parent, e.axis)
        try:
            refuse_out_of_range(Sine(e.swing_V, 0.0, "V", e.f_Hz), model)
        except BadInput as error:
            limits = model.limits
            raise BadInput(
                f"{e.axis}: the level of {e.swing_V:g} V at {e.f_Hz:g} Hz does not fit the limits "
                f"({limits.u_min_V:g}..{limits.u_max_V:g} V, {limits.slew_V_per_s:g} V/s): identify drives from 0 V; "
                "widen them with --model if the stage bears it, else choose smaller --levels or lower --frequencies"
            ) from error


def refuse_away_from_zero(device: Device) -> None:
    """Raises BadInput when an output does not stand at 0 V, where every experiment begins: it would jump there."""
    for axis, standing in standings(device).items():
        if abs(standing.u_V) >= LARGEST_STEP_V:
            raise BadInput(
                f"{axis}: its output stands at {standing.u_V:.3g} V but the experiments begin at 0 V; "
                "identify with a model whose u_park_V is 0, once the device is parked there"
            )


def _by_table(found: Stage, held_out: Sequence[Recording], report: FitReport) -> list[Verification]:
    """Those of the records that lie in the rectangle: it is smaller than the grid where sines at its edge were left
    out of the fit."""
    verifications = []
    for recording in held_out:
        try:
            verifications += verify(found, [recording], "table")
        except BadInput as error:
            report.messages.append(f"{recording.source}: not judged by the table view: {error}")
    return verifications


def _held_out(plan: Sequence[Experiment], kept: Sequence[Recording]) -> list[tuple[Recording, Experiment]]:
    return list(zip(kept, (e for e in plan if e.held_out), strict=True))


def after_first_period(recording: Recording, experiment: Experiment) -> Recording:
    """The recording scored from its second period on; the first warms the memory."""
    return replace(recording, scored=slice(round(TICK_HZ / experiment.f_Hz), None))


def run_experiment(device: Device, experiment: Experiment, *, alone: bool) -> tuple[Capture, Recording]:
    """One sine, open loop, recorded without a gap; scored after its settling periods.

    Raises:
        BadInput: the record is gapped, with what to do about it.
    """
    seconds = experiment.seconds - experiment.rest_s
    ticks = round(seconds * TICK_HZ)
    if experiment.rest_s:
        device.wait(experiment.rest_s)
    others = () if alone else tuple(a for a in AXES if a != experiment.axis)
    device.set_axis(experiment.axis, Mode.OPEN)
    device.set_path(experiment.axis, "sine", swing=experiment.swing_V, f_Hz=experiment.f_Hz, ticks=ticks)
    for other in others:
        device.set_axis(other, Mode.OPEN)
        device.set_path(other, "hold")
    capture = device.capture(ticks, axes="".join(sorted((experiment.axis, *others))), channels=CHANNELS)
    return capture, recording_of_experiment(capture, experiment)


def recording_of_experiment(capture: Capture, experiment: Experiment) -> Recording:
    """The capture in units, scored after its settling periods. Raises BadInput when it is gapped."""
    recording = recording_of(capture, meta={"mode": "open"})
    settle = round(experiment.settle_periods / experiment.f_Hz * TICK_HZ)
    recording = replace(recording, source=experiment.name, scored=slice(settle, None), sha256=recording.samples_sha256)
    refuse_gapped(recording)
    return recording
