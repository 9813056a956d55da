"""The identification experiment: which sines in which order, run on a device, then fitted and verified.

This is what `phaselead identify` does.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from phaselead.device import (
    LARGEST_STEP,
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
from phaselead.identify.fit_result import FitResult
from phaselead.identify.fitting import FitReport, fit
from phaselead.identify.kept import Kept
from phaselead.identify.plan import Experiment, plan_grid, plan_seconds
from phaselead.identify.verification import Verification, View, verify
from phaselead.identify.verifications import Verifications
from phaselead.model import AxisModel, Stage
from phaselead.record import AXES, Recording, refuse_gapped
from phaselead.waveforms import Sine, refuse_out_of_range

CHANNELS = Channel.ADC | Channel.DAC
FIT_SHARE = 0.1
"""Of the progress bar, for what comes after the last record."""


@dataclass(frozen=True)
class Identified:
    """A stage, how it was fitted, and how it does on the held-out records of the same session."""

    stage: Stage
    report: FitReport
    verifications: dict[View, list[Verification]]
    recordings: list[Recording]
    held_out: list[Recording]

    def as_fit(self) -> FitResult:
        """The result as people see it."""
        held_out = {view: Verifications(found, view, self.stage.name) for view, found in self.verifications.items()}
        return FitResult(self.stage, self.report, self.recordings, held_out)


def identify_device(
    device: Device,
    axes: Sequence[str] = ("x",),
    on_progress: Callable[[float], None] | None = None,
    *,
    plan: Sequence[Experiment] | None = None,
    kept: Kept | None = None,
    stage: Stage | None = None,
) -> Identified:
    """Run the plan (default: the paper's grid on ``axes``), fit both views, and verify on what was held out.

    One axis is recorded alone; for several, all three are recorded while each is driven, which gives the
    cross-coupling. The held-out records of the table view are judged whole; those of the time view from
    their second period on, because in a session no record but the first starts from rest. ``kept`` keeps every record
    as soon as it is there, and has those of a session that was cut short. Limits and calibration are those of
    ``stage``, which is uploaded first, else of the model that the device holds, else its defaults; they go on into what
    is identified.

    Raises:
        BadInput: the plan leaves the device's limits (nothing has moved), a record is gapped or the fit impossible.
    """
    chosen = list(plan) if plan is not None else plan_grid(axes)
    if stage is not None:
        refuse_beyond_limits(chosen, stage)
        device.upload_if_other(device_model(stage))
    parent, parent_sha256 = (stage, stage.sha256) if stage is not None else held_by(device)
    refuse_beyond_limits(chosen, parent)
    refuse_away_from_zero(device)
    try:
        records = _recorded(device, chosen, len(set(axes)) == 1, kept, on_progress)
    except KeyboardInterrupt as ended:
        ended.args = (after_interrupt(device),)
        raise
    used = [r for r, e in zip(records, chosen, strict=True) if not e.held_out]
    held_out = [r for r, e in zip(records, chosen, strict=True) if e.held_out]
    found, report = fit(used, name="identified", parent=parent)
    origin = found.provenance.model_copy(update={"parent_sha256": parent_sha256})
    found = found.model_copy(update={"provenance": origin})
    apart = [after_first_period(r, e) for r, e in _held_out(chosen, held_out)]
    verifications: dict[View, list[Verification]] = {"time": verify(found, apart, "time")}
    if all(found.axis(e.axis).table is not None for e in chosen):
        verifications["table"] = verify(found, held_out, "table")
    return Identified(found, report, verifications, used, held_out)


def _recorded(
    device: Device,
    plan: Sequence[Experiment],
    alone: bool,
    kept: Kept | None,
    on_progress: Callable[[float], None] | None,
) -> list[Recording]:
    """Every experiment of the plan, run now or found among what was kept."""
    total_s, done_s = plan_seconds(plan) / (1 - FIT_SHARE), 0.0
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
        done_s += experiment.seconds
        if on_progress is not None:
            on_progress(done_s / total_s)
    return records


def held_by(device: Device) -> tuple[Stage | None, str | None]:
    """Limits and calibration of the model the device holds, and the hash of the stage file it was made of."""
    blob = device.read_model()
    if blob is None:
        return None, None
    held = from_device_model(blob)
    return Stage(name="identified", axes=held.axes), held.stage_sha256


def refuse_beyond_limits(plan: Sequence[Experiment], parent: Stage | None) -> None:
    """Raises BadInput for the first level of the plan that the limits (without a parent: the defaults) leave out."""
    for e in plan:
        model = parent.axes.get(e.axis, AxisModel()) if parent is not None else AxisModel()
        try:
            refuse_out_of_range(Sine(e.swing_V, 0.0, "V", e.f_Hz), model)
        except BadInput as error:
            limits = model.limits
            raise BadInput(
                f"{e.axis}: the level of {e.swing_V:g} V at {e.f_Hz:g} Hz does not fit the limits "
                f"({limits.u_min_V:g}..{limits.u_max_V:g} V, {limits.slew_V_per_s:g} V/s): identify drives from 0 V; "
                "widen them with --model if the stage bears it, else record smaller sines and fit those"
            ) from error


def refuse_away_from_zero(device: Device) -> None:
    """Raises BadInput when an output does not stand at 0 V, where every experiment begins: it would jump there."""
    for axis, standing in standings(device).items():
        if abs(standing.u_V) >= LARGEST_STEP["V"]:
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
    recording = replace(recording, source=experiment.name, scored=slice(settle, None), sha256=_digest(recording))
    refuse_gapped(recording)
    return recording


def _digest(recording: Recording) -> str:
    """SHA-256 over the samples, for the stage file's provenance."""
    digest = hashlib.sha256(recording.t_s.tobytes())
    for axis in recording.axes.values():
        for values in (axis.u_V, axis.x_um):
            digest.update(b"" if values is None else values.tobytes())
    return digest.hexdigest()
