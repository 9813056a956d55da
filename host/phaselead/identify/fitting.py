"""From recordings to a stage file: which views the data allow, each axis fitted, and where it came from."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from phaselead.errors import BadInput, more_like_it
from phaselead.identify.coupling import CouplingMatrix, cross_coupling, decoupled
from phaselead.identify.modal import FittedModes, fit_straight, fit_together, fit_with_creep, measured_response
from phaselead.identify.odd_record import about_scale, about_unlike_record, refuse_turned_round, refuse_unlike_others
from phaselead.identify.operator import OperatorFit
from phaselead.identify.runs import (
    SAME_RATE,
    AxisRun,
    SineDrive,
    driven_axes,
    driven_runs,
    one_frequency,
    refuse_without_loop,
    sensor_counts_backwards,
    still_share,
    turned,
    usable,
)
from phaselead.identify.table import compare_with_table_1, comparison_text, lock_in, table_fit
from phaselead.model import (
    AdoptedEffect,
    AxisModel,
    Stage,
    TablePoint,
    TableView,
    effect_of_fading,
    effect_of_lag,
    effect_of_modes,
    explained,
    provenance_of,
)
from phaselead.record import Recording, doubts_about, glitch_doubts, same_measurement, times_in

Base = Literal["operator", "linear"]

MOSTLY_STILL = 0.5
"""Of the scored rows: what creeps in them counts more than what moves."""
BEYOND = 0.01
"""Of what records span: by less, rounding and calibration may take them beyond limits and sensor of a stage file."""


@dataclass(frozen=True)
class FitReport:
    """What was fitted, what it left, and what could not be fitted. ``lines()`` is for people."""

    time: dict[str, OperatorFit]
    table: dict[str, TableView]
    coupling: tuple[CouplingMatrix, CouplingMatrix] | None = None
    messages: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    """Records, or axes of records, of which nothing was used: which, why, and what to do."""
    base: Base = "operator"
    """What was fitted."""

    def lines(self) -> list[str]:
        found: list[str] = []
        for axis, result in self.time.items():
            found += [f"axis {axis}, time view", *str(result).splitlines()]
            if axis in self.table:
                found += [
                    f"axis {axis}, table view beside Xu & Li 2010",
                    *comparison_text(self.table[axis]).splitlines(),
                ]
        if self.coupling is not None:
            found.append("cross-coupling (row: responding axis)")
            rows = zip(*self.coupling, strict=True)
            found += ["  ".join(f"{v:8.4f} +- {s:.4f}" for v, s in zip(*row, strict=True)) for row in rows]
        return [*found, *self.messages, *self._left_out()]

    def remarks(self) -> list[str]:
        """What is worth knowing of the fit beside its numbers."""
        own = [f"axis {axis}: {message}" for axis, result in self.time.items() for message in result.messages]
        return [*own, *self.messages, *self._left_out()]

    def _left_out(self) -> list[str]:
        return [f"left out: {line}" for line in self.left_out]

    def as_dict(self) -> dict[str, Any]:
        """For JSON: numbers that are unknown are None."""
        axes = {
            axis: {
                "residual_um_rms": result.view.residual_um_rms,
                "field_bend": result.view.field_bend,
                "play_tilt": result.view.play_tilt,
                "play_taper": result.view.play_taper,
                "creep_per_decade": 0.0 if result.creep is None else result.creep.per_decade,
                "std": {name: [_known(v) for v in values] for name, values in result.std.items()},
                "records": [vars(record) for record in result.records],
                "table": [_known_row(vars(row)) for row in compare_with_table_1(self.table[axis])]
                if axis in self.table
                else None,
            }
            for axis, result in self.time.items()
        }
        return {
            "axes": axes,
            "messages": [*self.messages, *(m for r in self.time.values() for m in r.messages)],
            "left_out": self.left_out,
        }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _known_row(row: dict[str, Any]) -> dict[str, Any]:
    return {name: _known(value) if isinstance(value, float) else value for name, value in row.items()}


def fit(
    recordings: Sequence[Recording],
    base: Base = "operator",
    *,
    name: str = "fitted",
    parent: Stage | None = None,
    without: Callable[[Recording], Recording] | None = None,
    creep: bool = True,
) -> tuple[Stage, FitReport]:
    """Fit every driven axis of the recordings.

    ``base="linear"`` is gain and offset only. ``parent`` gives name, limits, calibration and gains, and its
    hash goes into the provenance. ``without`` takes from a recording what an effect beside the time view does in it;
    the table view is of what was measured. ``creep``: whether creep is looked for. Raises BadInput, one line, for data
    that cannot be used.
    """
    _refuse_mixture(recordings)
    _refuse_rows_given_twice(recordings)
    recordings, left_out = usable(recordings)
    doubts = _doubts(recordings)
    coupling = cross_coupling(recordings)
    runs, together = _runs_by_axis(decoupled(recordings, coupling[0]) if coupling else recordings)
    messages = [
        f"axis {a} was never driven alone: what it sees of the others is in its fit; record it alone for a model of it"
        for a in together
    ]
    own = runs
    if without is not None:
        less = [without(recording) for recording in recordings]
        own = _runs_by_axis(decoupled(less, coupling[0]) if coupling else less)[0]
    time, table, modes = {}, {}, {}
    for axis, axis_runs in runs.items():
        refuse_unlike_others(axis_runs)
        backwards = sensor_counts_backwards(axis_runs)
        forward = [turned(run) for run in own[axis]] if backwards else own[axis]
        with explained(f"axis {axis}: the fit leaves what a stage file can hold"):
            if base == "operator":
                refuse_without_loop(axis_runs)
                try:
                    found, mode = fit_with_creep(forward) if creep else fit_together(forward)
                except BadInput:
                    refuse_turned_round(axis_runs)
                    raise
                messages += about_scale(axis, axis_runs) or about_unlike_record(axis, forward, found, mode)
                messages += _about_creep(axis, found, axis_runs, looked_for=creep)
                messages += _about_modes(axis, mode, axis_runs, alone=axis not in together)
                messages += _about_lag(axis, found)
                messages += _about_field(axis, found)
                messages += _about_weights(axis, found)
                if mode is not None:
                    modes[axis] = mode
                view, said = _table(axis_runs, backwards)
                messages += said
                if view is not None:
                    table[axis] = view
            else:
                found = fit_straight(forward)
                messages.append(f"axis {axis}: gain and offset only, as asked; no table view")
        time[axis] = found.turned() if backwards else found
    axes: dict[Any, AxisModel] = {a: _axis_model(parent, a, time[a], table.get(a), modes.get(a)) for a in time}
    messages += [line for axis, of_axis in runs.items() for line in _beyond_what_is_known(axis, axes[axis], of_axis)]
    stage = Stage(
        name=parent.name if parent else name,
        provenance=provenance_of(parent, recordings).model_copy(update={"left_out": tuple(left_out) or None}),
        cross_coupling=coupling[0] if coupling and len(axes) > 1 else None,
        axes=axes,
    )
    return stage, FitReport(time, table, coupling, doubts + messages, left_out, base)


def _beyond_what_is_known(axis: str, model: AxisModel, runs: Sequence[AxisRun]) -> list[str]:
    """That the records go beyond limits or sensor of the stage file, which records do not tell."""
    low_V, high_V = min(float(run.u_V.min()) for run in runs), max(float(run.u_V.max()) for run in runs)
    low_um, high_um = min(float(run.x_um.min()) for run in runs), max(float(run.x_um.max()) for run in runs)
    limits, sensor, found = model.limits, model.sensor, []
    if max(limits.u_min_V - low_V, high_V - limits.u_max_V) > BEYOND * (high_V - low_V):
        found.append(f"{low_V:.4g}..{high_V:.4g} V (limits {limits.u_min_V:g}..{limits.u_max_V:g} V)")
    if max(sensor.x_min_um - low_um, high_um - sensor.x_max_um) > BEYOND * (high_um - low_um):
        found.append(f"{low_um:.4g}..{high_um:.4g} um (sensor {sensor.x_min_um:g}..{sensor.x_max_um:g} um)")
    if not found:
        return []
    return [
        f"axis {axis}: the records go beyond what the stage file has, {' and '.join(found)}: no record tells limits, "
        "sensor and converters; write those of your stage there before you drive it"
    ]


def _doubts(recordings: Sequence[Recording]) -> list[str]:
    """Whether the columns are what they were taken for, and whether rows stand alone, in one line for all of one
    doubt."""
    each = [line for lines in map(doubts_about, recordings) for line in lines]
    return [*([each[0] + more_like_it(len(each) - 1)] if each else []), *glitch_doubts(recordings)]


def _refuse_mixture(recordings: Sequence[Recording]) -> None:
    if not recordings:
        raise BadInput("no recordings to fit; give at least one file")
    first = recordings[0]
    for other in recordings[1:]:
        if len(other.axes) != len(first.axes):
            raise BadInput(
                f"{other.source}: has {len(other.axes)} axes but {first.source} has {len(first.axes)}; "
                "fit one-axis and three-axis recordings apart"
            )
        if abs(other.rate_Hz / first.rate_Hz - 1) > SAME_RATE:
            slow, fast = sorted((other, first), key=lambda one: one.rate_Hz)
            raise BadInput(
                f"{slow.source}: is sampled at {slow.rate_Hz:.6g} Hz but {fast.source} at {fast.rate_Hz:.6g} Hz; "
                f"{times_in(slow.rate_Hz, fast.rate_Hz) or 'fit recordings of one rate together'}"
            )


def _refuse_rows_given_twice(recordings: Sequence[Recording]) -> None:
    for i, later in enumerate(recordings):
        for one in recordings[:i]:
            if _share_rows(one, later):
                raise BadInput(f"{later.source}: its rows are also in another record ({one.source}); give them once")


def _share_rows(a: Recording, b: Recording) -> bool:
    """Whether two recordings are of one file and some of their rows are the same."""
    if not a.sha256 or a.sha256 != b.sha256 or not same_measurement(a, b):
        return False
    n = min(len(a.t_s), len(b.t_s))  # a window has all rows before it
    pairs = [(a.axes[axis].x_um, b.axes[axis].x_um) for axis in a.axes if axis in b.axes]
    return all(x is None or y is None or np.array_equal(x[:n], y[:n]) for x, y in pairs)


def _runs_by_axis(recordings: Sequence[Recording]) -> tuple[dict[str, list[AxisRun]], list[str]]:
    """The runs of each driven axis: those that drive it alone, unless there are none; and the axes without any."""
    alone: dict[str, list[AxisRun]] = {}
    together: dict[str, list[AxisRun]] = {}
    for recording in recordings:
        driven = driven_axes(recording)
        for axis, run in driven_runs(recording)[0].items():
            (alone if len(driven) == 1 else together).setdefault(axis, []).append(run)
    never = [axis for axis in together if axis not in alone]
    alone |= {axis: together[axis] for axis in never}
    return {axis: alone[axis] for axis in sorted(alone)}, never


def _table(runs: Sequence[AxisRun], backwards: bool) -> tuple[TableView | None, list[str]]:
    """The table view when the runs are a grid of sines, and why not when they are not."""
    axis, messages = runs[0].axis, []
    if backwards:
        return None, [f"axis {axis}: time view only; a table view needs a position that rises with the voltage"]
    points: list[TablePoint] = []
    for run in runs:
        if not _is_paper_sine(run.sine):
            continue
        try:
            points.append(lock_in(run).point())
        except BadInput as error:
            messages.append(f"left out of the table view: {error}")
    if not points:
        return None, [*messages, f"axis {axis}: time view only; a table view needs sines that start at 0 V"]
    try:
        return table_fit(points), messages
    except BadInput as error:
        return None, [*messages, f"axis {axis}: time view only; {error}"]


def _is_paper_sine(sine: SineDrive | None) -> bool:
    return sine is not None and sine.starts_at_zero


def _axis_model(
    parent: Stage | None, axis: str, time: OperatorFit, table: TableView | None, mode: FittedModes | None
) -> AxisModel:
    view = time.view
    effects = (*_adopted_lag(time), *_adopted_fading(time), *_adopted_creep(time))
    if mode is not None:
        view, effect = mode.adopted(view)
        effects = (*effects, effect)
    known = parent.axes.get(axis) if parent else None
    if known is None:
        return AxisModel(table=table, time=view, effects=effects)
    return AxisModel(
        limits=known.limits,
        sensor=known.sensor,
        actuator=known.actuator,
        gains=known.gains,
        table=table,
        time=view,
        effects=effects,
    )


def _about_creep(axis: str, found: OperatorFit, runs: Sequence[AxisRun], *, looked_for: bool) -> list[str]:
    """How much the stage creeps; where nothing tells it, what to say of records beside others that mostly stand
    still."""
    if found.creep is not None:
        return [
            f"axis {axis}: goes on by {100 * found.creep.per_decade:.2g} % per decade of time; adopted as effect creep"
        ]
    still = [run.source for run in runs if still_share(run) > MOSTLY_STILL]
    if (looked_for and not one_frequency(runs)) or not still or len(still) == len(runs):
        return []
    more = f" and {len(still) - 1} more" if len(still) > 1 else ""
    return [
        f"axis {axis}: the voltage mostly stands still in {still[0]}{more}: what creeps meanwhile is no part of the "
        "time view and bends it; leave such records out (identify finds creep from its own, `phaselead gap` from any)"
    ]


def _about_modes(axis: str, found: FittedModes | None, runs: Sequence[AxisRun], *, alone: bool) -> list[str]:
    """Which modes were found or, without any, how fast the records drive the axis: above that it may have some.

    ``alone``: no other axis is driven meanwhile, whose motion would hide them.
    """
    if found is not None:
        return [_describe_modes(axis, found)]
    if not alone:
        return [
            f"axis {axis}: no mode found, but the motion of the other axes may hide some; drive it alone, or have "
            "`phaselead gap` find the modes that the axes have in common"
        ]
    response = measured_response(runs).unbroken
    if not response.broadband:
        return [
            f"axis {axis}: no mode seen, and driven at too few frequencies to tell that it has none; record steps or a "
            "multisine for one"
        ]
    return [f"axis {axis}: shows no mode up to {response.f_Hz[-1]:.0f} Hz; the records do not drive it faster"]


def _about_lag(axis: str, found: OperatorFit) -> list[str]:
    if not found.lag_s:
        return []
    size, (std,) = found.lag_s, found.std["lag_s"]
    sure = f" +- {_duration(std)}" if math.isfinite(std) else ""
    return [
        f"axis {axis}: a lag of {_duration(size)}{sure} beside the delay, of amplifier or sensor: the records do not "
        f"tell which; adopted provisionally as effect {effect_of_lag(size)[0].name}"
    ]


def _about_field(axis: str, found: OperatorFit) -> list[str]:
    bend = found.view.field_bend
    if not bend:
        return []
    return [
        f"axis {axis}: its hysteresis answers to a field that rises {1 - 2 * bend:.2g} times as fast at one end of the "
        f"range, {1 + 2 * bend:.2g} at the other (field_bend of its time view)"
    ]


def _about_weights(axis: str, found: OperatorFit) -> list[str]:
    view = found.view
    if view.density.is_even:
        return []
    low, high = view.density.at(view.density.span_V)
    return [
        f"axis {axis}: its plays weigh {low:.3g} times as much at the lower end of the range as in its middle, "
        f"{high:.3g} times at the upper (play_tilt and play_taper of its time view)"
    ]


def _duration(time_s: float) -> str:
    """In us, from a millisecond on in ms; three digits."""
    return f"{1e6 * time_s:.3g} us" if time_s < 999.5e-6 else f"{1e3 * time_s:.3g} ms"


def _adopted_lag(found: OperatorFit) -> tuple[AdoptedEffect, ...]:
    """Whether amplifier or sensor lags is not known: behind the operator a lag would be the same but for its loop."""
    if not found.lag_s:
        return ()
    effect, params = effect_of_lag(found.lag_s)
    ci95 = {} if found.lag_ci95_s is None else dict.fromkeys(params, found.lag_ci95_s)
    return (AdoptedEffect(name=effect.name, status="provisional", params=params, ci95=ci95, share=found.lag_share),)


def _adopted_fading(found: OperatorFit) -> tuple[AdoptedEffect, ...]:
    """The part of the operator that forgets."""
    if not len(found.fading_r_V):
        return ()
    effect, params = effect_of_fading(found.fading_r_V, found.fading_w_um_per_V, AxisModel(time=found.view))
    return (AdoptedEffect(name=effect.name, params=params),)


def _adopted_creep(found: OperatorFit) -> tuple[AdoptedEffect, ...]:
    """What was taken out of the records before the fit."""
    if found.creep is None:
        return ()
    effect, params = found.creep.entry
    return (AdoptedEffect(name=effect.name, params=params, share=found.creep_share),)


def _describe_modes(axis: str, found: FittedModes) -> str:
    each = [f"a mode at {f_Hz:.4g} Hz, zeta {zeta:.2g}" for _, f_Hz, zeta in found.modes]
    if len(each) > 1:
        each[1] += f", of {100 * found.modes[1][0]:.2g} % of the motion"
    explained = 100 * (1 - found.share_left)
    return (
        f"axis {axis}: {' and '.join(each)}, explain{'s' if len(each) == 1 else ''} {explained:.0f} % of "
        f"the squared residual of the operator; adopted as effect {effect_of_modes(found.modes)[0].name}"
    )
