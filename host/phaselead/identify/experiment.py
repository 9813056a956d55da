"""The identification experiment: which sines in which order, run on a device, then fitted and verified.

This is what `phaselead identify` does.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from phaselead.device import (
    LARGEST_STEP,
    TICK_HZ,
    Capture,
    Channel,
    Device,
    Mode,
    device_model,
    from_device_model,
    recording_of,
    standings,
    write_run,
)
from phaselead.errors import BadInput
from phaselead.identify.fit_result import FitResult
from phaselead.identify.fitting import FitReport, fit
from phaselead.identify.verification import Verification, View, verify
from phaselead.identify.verifications import Verifications
from phaselead.model import AxisModel, Stage
from phaselead.record import AXES, Recording, refuse_gapped
from phaselead.waveforms import Sine, refuse_out_of_range

LEVELS_V = (0.5, 1.0, 2.0, 3.5, 4.5, 6.0, 8.0, 10.0)
FREQUENCIES_HZ = (1.0, 2.0, 4.0, 7.0, 10.0, 13.0, 17.0, 20.0)
HELD_OUT = ((3.0, 15.0), (5.0, 5.0))
"""The inputs on which Xu & Li 2010 verify, as (swing in V, frequency in Hz)."""
CHANNELS = Channel.ADC | Channel.DAC
FIT_SHARE = 0.1
"""Of the progress bar, for what comes after the last record."""


@dataclass(frozen=True)
class Experiment:
    """A sine from 0 V to ``swing_V`` on one axis, the others at 0 V."""

    axis: str
    swing_V: float
    f_Hz: float
    settle_periods: int
    measure_periods: int
    held_out: bool = False
    rest_s: float = 0.0
    """Still at 0 V before it starts."""

    @property
    def seconds(self) -> float:
        return self.rest_s + (self.settle_periods + self.measure_periods) / self.f_Hz


def plan_grid(
    axes: Sequence[str] = ("x",),
    *,
    levels_V: Sequence[float] = LEVELS_V,
    f_Hz: Sequence[float] = FREQUENCIES_HZ,
    held_out: Sequence[tuple[float, float]] = HELD_OUT,
    settle_periods: int = 1,
    measure_periods: int = 4,
    rest_s: float = 3.0,
) -> list[Experiment]:
    """The paper's grid for each axis in turn, and the inputs kept for verification.

    Levels only rise, the held-out ones at their place among them: a steady loop that grows past every earlier
    one leaves the memory above it as it was at rest, so each settled record is what a stage fresh from rest
    would come to. Only its first rise differs, so a figure *from rest* needs a device that was just opened.
    Within a level the slow sines come last, and every sine waits ``rest_s`` at 0 V: else the creep of one is
    the offset of the next, by half a per cent of the range. Raises BadInput.
    """
    if len(set(axes)) != len(axes) or not set(axes) <= set(AXES):
        raise BadInput(f"axes {','.join(axes)}: name each of x, y, z at most once")
    if not all(v > 0 for v in (*levels_V, *f_Hz)) or settle_periods < 0 or measure_periods < 2:
        raise BadInput("the grid needs positive levels and frequencies, and at least 2 periods to measure")
    grid = [(swing, f, False) for swing in levels_V for f in f_Hz]
    kept = [(swing, f, True) for swing, f in held_out]
    common = {(s, f) for s, f, _ in grid} & set(held_out)
    if common:
        swing, f = sorted(common)[0]
        raise BadInput(f"{swing:g} V {f:g} Hz is held out and must not be in the grid; choose another point")
    plan = []
    for axis in axes:
        for swing, f, held in sorted(kept + grid, key=lambda e: (e[0], not e[2], -e[1])):
            plan.append(Experiment(axis, swing, f, settle_periods, measure_periods, held, rest_s))
    return plan


def plan_seconds(plan: Sequence[Experiment]) -> float:
    """How long the device is driven, pauses included."""
    return float(np.sum([e.seconds for e in plan]))


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
    save_to: str | None = None,
    stage: Stage | None = None,
) -> Identified:
    """Run the plan (default: the paper's grid on ``axes``), fit both views, and verify on what was held out.

    One axis is recorded alone; for several, all three are recorded while each is driven, which gives the
    cross-coupling. The held-out records of the table view are judged whole; those of the time view from
    their second period on, because in a session no record but the first starts from rest. ``save_to`` keeps
    every record there. Limits and calibration are those of ``stage``, which is uploaded first, else of the model
    that the device holds, else its defaults; they go on into what is identified.

    Raises:
        BadInput: the plan leaves the device's limits (nothing has moved), a record is gapped or the fit impossible.
    """
    chosen = list(plan) if plan is not None else plan_grid(axes)
    folder = _folder(save_to)
    if stage is not None:
        refuse_beyond_limits(chosen, stage)
        device.upload_if_other(device_model(stage))
    parent, parent_sha256 = (stage, stage.sha256) if stage is not None else held_by(device)
    refuse_beyond_limits(chosen, parent)
    refuse_away_from_zero(device)
    records = _recorded(device, chosen, len(set(axes)) == 1, folder, on_progress)
    used = [r for r, e in zip(records, chosen, strict=True) if not e.held_out]
    kept = [r for r, e in zip(records, chosen, strict=True) if e.held_out]
    found, report = fit(used, name="identified", parent=parent)
    origin = found.provenance.model_copy(update={"parent_sha256": parent_sha256})
    found = found.model_copy(update={"provenance": origin})
    verifications: dict[View, list[Verification]] = {
        "time": verify(found, [after_first_period(r, e) for r, e in _held_out(chosen, kept)], "time"),
        "table": verify(found, kept, "table"),
    }
    return Identified(found, report, verifications, used, kept)


def _recorded(
    device: Device,
    plan: Sequence[Experiment],
    alone: bool,
    folder: Path | None,
    on_progress: Callable[[float], None] | None,
) -> list[Recording]:
    """Every experiment of the plan run, and kept in the folder if there is one."""
    total_s, done_s = plan_seconds(plan) / (1 - FIT_SHARE), 0.0
    records = []
    for experiment in plan:
        capture, recording = run_experiment(device, experiment, alone=alone)
        if folder is not None:
            write_run(folder / f"{recording.source}.h5", capture, recording)
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


def _folder(save_to: str | None) -> Path | None:
    if save_to is None:
        return None
    folder = Path(save_to)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{save_to}: no folder can be made there ({error.strerror}); give another with --save") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise BadInput(f"{save_to}: the folder cannot be written to; give another with --save")
    return folder


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
    recording = recording_of(capture, meta={"mode": "open"})
    settle = round(experiment.settle_periods / experiment.f_Hz * TICK_HZ)
    name = f"{experiment.axis}-{experiment.swing_V:g}V-{experiment.f_Hz:g}Hz"
    recording = replace(recording, source=name, scored=slice(settle, None), sha256=_digest(recording))
    refuse_gapped(recording)
    return capture, recording


def _digest(recording: Recording) -> str:
    """SHA-256 over the samples, for the stage file's provenance."""
    digest = hashlib.sha256(recording.t_s.tobytes())
    for axis in recording.axes.values():
        for values in (axis.u_V, axis.x_um):
            digest.update(b"" if values is None else values.tobytes())
    return digest.hexdigest()
