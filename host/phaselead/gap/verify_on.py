"""Verification on a device: how well it tracks the same paths with the model before and with the one after."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from phaselead.control import TrackingError, track, tracking_error
from phaselead.device import TICK_HZ, Device, inverse_refusal
from phaselead.errors import PhaseleadError
from phaselead.model import AxisModel, Place, Stage, compensation, effect, rest_position_um
from phaselead.record import Samples
from phaselead.result import Result, Table
from phaselead.waveforms import JUDGED_PERIODS, SETTLE_S, Goto, Periodic, Sine, Triangle, Waveform

SINE_Hz, TRIANGLE_Hz, MOVE_Hz = 5.0, 20.0, 10.0
"""Frequencies of the paths; that of a move stands for its duration."""
HOLD_s = 6.0
"""After a move, so that creep shows."""
PATH_START, PATH_SWING = 0.1, 0.5
"""Where a path begins and how far it goes, as shares of what every model can reach."""
SHOWN_PERIODS = 2
ROW = ("axis", "path", "mode")


@dataclass(frozen=True)
class TrackedPath:
    """One axis on one path with both models. Errors are reference minus measured position; arrays are (n,)."""

    axis: str
    path: str
    mode: str
    before: TrackingError
    after: TrackingError
    t_s: Samples
    r_um: Samples
    before_error_um: Samples
    after_error_um: Samples

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        errors = {"before": self.before.as_dict(), "after": self.after.as_dict()}
        return {"axis": self.axis, "path": self.path, "mode": self.mode, **errors}


@dataclass(frozen=True)
class TrackingComparison(Result):
    """Tracking errors before and after; ``messages`` say what was not run, and why."""

    port: str
    tracked: tuple[TrackedPath, ...] = ()
    messages: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """For JSON, as one more field of gap.json."""
        rows = [row.as_dict() for row in self.tracked]
        return {"tracking": {"port": self.port, "runs": rows, "messages": list(self.messages)}}

    @property
    def columns(self) -> dict[str, list[object]]:
        """One entry for each path: axis, path, mode, before_rms_um, after_rms_um."""
        found: dict[str, list[object]] = {name: [getattr(r, name) for r in self.tracked] for name in ROW}
        found["before_rms_um"] = [row.before.rms_um for row in self.tracked]
        return found | {"after_rms_um": [row.after.rms_um for row in self.tracked]}

    def tables(self) -> list[Table | str]:
        headings = ("axis", "path", "mode", "before (µm rms)", "after (µm rms)")
        rows = ((r.axis, r.path, r.mode, f"{r.before.rms_um:.4g}", f"{r.after.rms_um:.4g}") for r in self.tracked)
        table = Table(headings, tuple(rows), f"tracking on {self.port}")
        return [*([table] if self.tracked else []), *self.messages]


def check_port(port: str) -> None:
    """Open and close a session on the port, so that it fails before the search and not after. Raises PhaseleadError."""
    Device.open(port).close()


def verify_on(
    port: str, before: Stage, after: Stage, on_progress: Callable[[float], None] | None = None
) -> TrackingComparison:
    """Track with every axis whose model changed, under both models, with the stage parked in between.

    Modes are ``inverse``, feed-forward alone, and ``inverse+pid`` where the stage file has gains. An error of the
    device ends the verification with a message and is not raised, since the search before it has its result.
    """
    changed = [name for name in sorted(after.axes) if after.axes[name] != before.axes.get(name)]
    if not changed:
        return TrackingComparison(port, messages=("the model did not change; there is nothing to verify",))
    named = _with_neighbours(changed, after)
    reasons = {name: _not_run(name, before, after) for name in named}
    messages = [reason for reason in reasons.values() if reason is not None]
    axes = [name for name in named if reasons[name] is None]
    runs = [(mode, paths) for mode in _modes(axes, after) for paths in _paths(axes, before, after)]
    tracked: list[TrackedPath] = []
    try:
        for i, (mode, (label, paths)) in enumerate(runs):
            tracked += _with_both_models(port, label, paths, mode, before, after)
            if on_progress is not None:
                on_progress((i + 1) / len(runs))
    except PhaseleadError as error:
        messages.append(f"on {port} it went no further: {error}")
    return TrackingComparison(port, tuple(tracked), tuple(messages))


def _with_neighbours(changed: Sequence[str], after: Stage) -> list[str]:
    """The changed axes; all of them where one is coupled, since that shows only while the others move."""
    coupled = any(_has_effect_at(Place.COUPLING, after.axes[name]) for name in changed)
    return sorted(after.axes) if coupled else list(changed)


def _has_effect_at(place: Place, model: AxisModel) -> bool:
    return any(effect(adopted.name).place == place for adopted in model.effects)


def _not_run(name: str, before: Stage, after: Stage) -> str | None:
    """Why an axis cannot be driven, None where it can."""
    for when, stage in (("before", before), ("after", after)):
        reason = inverse_refusal(stage.axes[name], name) if name in stage.axes else "the stage file lacks it"
        if reason is not None:
            return f"axis {name} was not driven: the model {when} has no inverse: {reason}"
    return None


def _modes(axes: Sequence[str], after: Stage) -> list[str]:
    if not axes:
        return []
    tuned = all(after.axes[name].gains is not None for name in axes)
    return ["inverse", "inverse+pid"] if tuned else ["inverse"]


def _paths(axes: Sequence[str], before: Stage, after: Stage) -> list[tuple[str, dict[str, Waveform]]]:
    """Name of each path and what every axis follows; several axes move at the same time."""
    spans = {name: _span_um(before.axes[name], after.axes[name]) for name in axes}
    found = [
        (f"sine, {SINE_Hz:g} Hz", _periodic(spans, Sine, SINE_Hz)),
        (f"triangle, {TRIANGLE_Hz:g} Hz", _periodic(spans, Triangle, TRIANGLE_Hz)),
    ]
    if any(_has_effect_at(Place.CREEP, after.axes[name]) for name in axes):
        moves = {n: Goto(PATH_SWING * (high - low), low, "um", MOVE_Hz) for n, (low, high) in spans.items()}
        found.append((f"move and hold, {HOLD_s:g} s", {**moves}))
    return found


def _periodic(spans: Mapping[str, tuple[float, float]], kind: type[Periodic], f_Hz: float) -> dict[str, Waveform]:
    """A path for each axis, at a frequency of its own, so that coupling between them shows."""
    return {
        name: kind(PATH_SWING * (high - low), low + PATH_START * (high - low), "um", f_Hz * (1 + 0.4 * i))
        for i, (name, (low, high)) in enumerate(spans.items())
    }


def _span_um(*models: AxisModel) -> tuple[float, float]:
    """Lowest and highest position that every model can reach and the sensor sees, from rest on."""
    lows, highs = [], []
    for model in models:
        found = compensation(model)
        lows.append(max(found.reach_um[0], rest_position_um(found.view), model.sensor.x_min_um))
        highs.append(min(found.reach_um[1], model.sensor.x_max_um))
        if model.table is not None:
            highs.append(model.table.range_um[1])
    return max(lows), min(highs)


def _with_both_models(
    port: str, label: str, paths: Mapping[str, Waveform], mode: str, before: Stage, after: Stage
) -> list[TrackedPath]:
    """One path with both models, each on a freshly opened device; a move begins where the axis stands."""
    runs = [_run(port, paths, mode, stage) for stage in (before, after)]
    found = []
    for name, waveform in paths.items():
        t_s = runs[0][name][0]
        judged = waveform.judged_rows(len(t_s), TICK_HZ)
        shown = waveform.last_rows(SHOWN_PERIODS, len(t_s), TICK_HZ)
        (_, r_um, x_um), (_, r_after_um, x_after_um) = (run[name] for run in runs)
        found.append(
            TrackedPath(
                name,
                label,
                mode,
                tracking_error(r_um[judged], x_um[judged]),
                tracking_error(r_after_um[judged], x_after_um[judged]),
                t_s[shown],
                r_um[shown],
                (r_um - x_um)[shown],
                (r_after_um - x_after_um)[shown],
            )
        )
    return found


def _run(
    port: str, paths: Mapping[str, Waveform], mode: str, stage: Stage
) -> dict[str, tuple[Samples, Samples, Samples]]:
    """Times, reference and measured position (n,) of every axis."""
    gains = {name: stage.axes[name].gains for name in paths}
    with Device.open(port) as device:
        run = track(
            device,
            paths,
            mode,
            stage=stage,
            gains={name: own for name, own in gains.items() if own is not None} if mode == "inverse+pid" else None,
            duration_s=_seconds(paths),
        )
    found = {}
    for name in paths:
        record = run.recording.axes[name]
        assert record.r_um is not None
        assert record.x_um is not None
        found[name] = (run.recording.t_s - run.recording.t_s[0], record.r_um, record.x_um)
    return found


def _seconds(paths: Mapping[str, Waveform]) -> float:
    """Long enough to settle and to judge the slowest path."""
    slowest = max(w.duration_s for w in paths.values())
    if not all(w.periodic for w in paths.values()):
        return slowest + HOLD_s
    return max((JUDGED_PERIODS + 2) * slowest, SETTLE_S)
