"""The identification experiment: which sines in which order, run on a device, then fitted and verified.

This is what `phaselead identify` does.
"""

from __future__ import annotations

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
from phaselead.identify import creep as creeping
from phaselead.identify.fit_result import FitResult
from phaselead.identify.fitting import FitReport, fit
from phaselead.identify.kept import Kept
from phaselead.identify.plan import Experiment, plan_grid, plan_seconds
from phaselead.identify.verification import Verification, View, verify
from phaselead.identify.verifications import Verifications
from phaselead.model import AxisModel, Stage, provenance_of
from phaselead.record import AXES, Recording, refuse_gapped
from phaselead.sim import data_sheet
from phaselead.waveforms import Goto, Sine, refuse_out_of_range

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
    creep: bool = False,
) -> Identified:
    """Run the plan (default: the paper's grid on ``axes``), fit both views, and verify on what was held out.

    One axis is recorded alone; for several, all three are recorded while each is driven, which gives the
    cross-coupling. The held-out records of the table view are judged whole; those of the time view from
    their second period on, because in a session no record but the first starts from rest. ``kept`` keeps every record
    of the plan as soon as it is there, and has those of a session that was cut short. Limits and calibration are those
    of ``stage``, which is uploaded first, else of the model that the device holds, else a built-in stage's own,
    else the defaults; they go on into what is identified. ``creep``: at the end each axis also holds 5 V, or the
    largest level of the plan if that is less, for 12 s, after 40 s of rest, and its creep is fitted. That takes the
    records of one session.

    Raises:
        BadInput: the plan leaves the device's limits or ``creep`` is wanted of kept records (nothing has moved), a
            record is gapped or the fit impossible.
    """
    chosen = list(plan) if plan is not None else plan_grid(axes)
    holds = {axis: creeping.hold_of(chosen, axis) for axis in (axes if creep else ())}
    if creep and kept is not None:
        refuse_resumed(chosen, kept)
        kept.remedy = "go on with --resume, without --creep"
    if stage is not None:
        refuse_beyond_limits(chosen, stage, holds)
        device.upload_if_other(device_model(stage))
    parent, parent_sha256 = (stage, stage.sha256) if stage is not None else held_by(device)
    if parent is None and (sheet := data_sheet(device.session.name)) is not None:
        parent = sheet.model_copy(update={"name": "identified"})
        if not is_assumed(parent):
            device.upload(device_model(parent))
    refuse_beyond_limits(chosen, parent, holds)
    refuse_away_from_zero(device)
    progress = Progress(plan_seconds(chosen) + creeping.SECONDS * len(holds), on_progress)
    held: dict[str, Recording] = {}
    try:
        records = _recorded(device, chosen, len(set(axes)) == 1, kept, progress)
        for axis, move in holds.items():
            held[axis] = creeping.hold(device, axis, move)
            progress.add(creeping.SECONDS)
    except KeyboardInterrupt as ended:
        ended.args = (after_interrupt(device),)
        raise
    used = [r for r, e in zip(records, chosen, strict=True) if not e.held_out]
    held_out = [r for r, e in zip(records, chosen, strict=True) if e.held_out]
    found, report = fit(used, name="identified", parent=parent)
    origin = found.provenance.model_copy(update={"parent_sha256": parent_sha256})
    found = found.model_copy(update={"provenance": origin})
    for axis, record in held.items():
        mine = [(r, e) for r, e in zip(records, chosen, strict=True) if e.axis == axis]
        fits, rest_s = [not e.held_out for _, e in mine], mine[0][1].rest_s
        found = creeping.with_creep(found, axis, record, [r for r, _ in mine], fits, rest_s)
        source = provenance_of(None, [replace(record, sha256=record.samples_sha256)]).data
        origin = found.provenance.model_copy(update={"data": (*found.provenance.data, *source)})
        found = found.model_copy(update={"provenance": origin})
        report.messages.append(f"axis {axis}: {creeping.described_creep(found.axis(axis))}; adopted as effect creep")
    apart = [after_first_period(r, e) for r, e in _held_out(chosen, held_out)]
    verifications: dict[View, list[Verification]] = {"time": verify(found, apart, "time")}
    if all(found.axis(e.axis).table is not None for e in chosen):
        verifications["table"] = verify(found, held_out, "table")
    return Identified(found, report, verifications, used, held_out, held)


def _recorded(
    device: Device,
    plan: Sequence[Experiment],
    alone: bool,
    kept: Kept | None,
    progress: Progress,
) -> list[Recording]:
    """Every experiment of the plan, run now or found among what was kept."""
    records = []
    for experiment in plan:
        capture = kept.found(experiment.name, device) if kept is not None else None
        known = capture is not None
        if capture is None:
            capture = run_experiment(device, experiment, alone=alone)[0]
        recording = recording_of_experiment(capture, experiment)
        if kept is not None and not known:
            kept.add(capture, recording)
        records.append(recording)
        progress.add(experiment.seconds)
    return records


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


def refuse_resumed(plan: Sequence[Experiment], kept: Kept) -> None:
    """Raises BadInput where records of the plan are there already: creep goes on from one record into the next, and a
    session that was broken off did not rest between two of them as planned."""
    if there := [e.name for e in plan if kept.path(e.name).exists()]:
        raise BadInput(
            f"{kept.folder}: holds {len(there)} records of an earlier session, and creep takes those of one; leave "
            "--creep out, or measure all again with --overwrite instead of --resume"
        )


def refuse_beyond_limits(plan: Sequence[Experiment], parent: Stage | None, holds: Mapping[str, Goto]) -> None:
    """Raises BadInput for the largest level of the plan, or move into a hold, that the limits (without a parent: the
    defaults) leave out."""

    def model_of(axis: str) -> AxisModel:
        return parent.axes.get(axis, AxisModel()) if parent is not None else AxisModel()

    for e in sorted(plan, key=lambda e: -e.swing_V):
        model = model_of(e.axis)
        try:
            refuse_out_of_range(Sine(e.swing_V, 0.0, "V", e.f_Hz), model)
        except BadInput as error:
            limits = model.limits
            raise BadInput(
                f"{e.axis}: the level of {e.swing_V:g} V at {e.f_Hz:g} Hz does not fit the limits "
                f"({limits.u_min_V:g}..{limits.u_max_V:g} V, {limits.slew_V_per_s:g} V/s): identify drives from 0 V; "
                "widen them with --model if the stage bears it, else record smaller sines and fit those"
            ) from error
    for axis, move in holds.items():
        try:
            refuse_out_of_range(move, model_of(axis))
        except BadInput as error:
            raise BadInput(
                f"{axis}: --creep moves to {move.swing:g} V at up to {move.steepest():.3g} V/s, which its slew limit "
                f"({model_of(axis).limits.slew_V_per_s:g} V/s) does not bear; leave it out, or choose smaller levels"
            ) from error


def refuse_away_from_zero(device: Device) -> None:
    """Raises BadInput when an output does not stand at 0 V, where every experiment begins: it would jump there."""
    for axis, standing in standings(device).items():
        if abs(standing.u_V) >= LARGEST_STEP_V:
            raise BadInput(
                f"{axis}: its output stands at {standing.u_V:.3g} V but the experiments begin at 0 V; "
                "identify with a model whose u_park_V is 0, once the device is parked there"
            )


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
