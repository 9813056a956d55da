"""What the device undoes in modes inverse and inverse+pid, from an axis' time view and adopted effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phaselead.control.sections import PASS, Section, Undone, undo_lowpass, undo_modes
from phaselead.effects import effect
from phaselead.effects.creep import terms
from phaselead.effects.effect import Params, Samples, number
from phaselead.effects.resonance import modes
from phaselead.errors import BadInput
from phaselead.stage.file import AxisModel, Effect, Limits, Stage, TimeView
from phaselead.stage.folded import folded

PLAYS, KNOTS, TERMS, SECTIONS = 32, 24, 8, 6
"""What the device holds of each (firmware/core)."""
LARGEST_THRESHOLD_V = 64.0
"""Of a play, and the fastest creep: alpha is at most 1/4."""
FASTEST_CREEP_s = 0.0007
LEAST_SLOPE = 2.0**-10
"""um/V; flatter than this the device does not invert."""
IN_TIME_VIEW = ("hysteresis", "asymmetric_hysteresis", "delay", "gain_change", "offset")
IN_CHAIN = ("creep", "resonance", "load_change", "amplifier_lowpass", "sensor_lowpass")
BETWEEN_AXES = ("cross_coupling",)
COMPENSATED = frozenset((*IN_TIME_VIEW, *IN_CHAIN, *BETWEEN_AXES))
"""Effects that an upload turns into something the device does. The skew of asymmetric_hysteresis is left."""


@dataclass(frozen=True)
class Compensation:
    """The chain of one axis, undone from its end to its beginning."""

    view: TimeView
    """Plays and dead zones in rising order, those without weight left out."""
    creep_k: tuple[float, ...]
    creep_tau_s: tuple[float, ...]
    shape: tuple[Section, ...]
    """On the position that is asked for: sensor and mechanics."""
    drive: Section
    """On the voltage: amplifier."""
    preview_s: float
    """How far ahead the reference is looked up: delay, and what filters and sections delay together."""
    reach_um: tuple[float, float]
    """Positions that can be had whatever the memory."""

    def shape_response(self, f_Hz: Samples) -> NDArray[np.complex128]:
        """Complex gain of all sections on the position."""
        return np.asarray(np.prod([s.response(f_Hz) for s in (*self.shape, PASS)], axis=0))


def compensation(axis: AxisModel) -> Compensation:
    """What undoes an axis. Raises BadInput with the reason when nothing does: no time view, or no stable inverse."""
    if axis.time is None:
        raise BadInput("it has no time view; fit or identify it")
    view = _in_order(_inverted_view(axis))
    least, at_V = _least_slope(view, axis.limits)
    if least < LEAST_SLOPE:
        raise BadInput(
            f"its time view falls or stands still at {at_V:.4g} V (after a turn it rises by {least:.3g} um/V), so no "
            "voltage belongs to a position; fit it on records of that range, or narrow its limits"
        )
    effects = _by_name(axis)
    k, tau_s = _creep(effects)
    amplifier = _lowpass(effects, "amplifier_lowpass")
    before = [_lowpass(effects, "sensor_lowpass"), *_mechanics(effects)]
    shape = tuple(section for undone in before for section in undone.sections)
    preview_s = view.delay_s + amplifier.delay_s + sum(undone.delay_s for undone in before)
    found = Compensation(
        view, k, tau_s, shape, amplifier.sections[0] if amplifier.sections else PASS, max(preview_s, 0.0),
        _reach_um(view, axis.limits),
    )  # fmt: skip
    _refuse_more_than_it_holds(found)
    return found


def coupling(stage: Stage) -> list[list[float]]:
    """What axis i (row) sees of the motion of axis j, 1 on the diagonal: the stage's matrix and the adopted effects."""
    names = ("x", "y", "z")
    matrix = [[float(i == j) for j in range(3)] for i in range(3)]
    for i, name in enumerate(names):
        for j in range(3):
            if i != j and stage.cross_coupling is not None:
                matrix[i][j] = float(stage.cross_coupling[i][j])
        if name in stage.axes:
            params = _by_name(stage.axes[name]).get("cross_coupling", {})
            for j, other in enumerate(names):
                if i != j:  # through shared modes: at rest every mode passes its share on
                    matrix[i][j] += sum(
                        float(np.sum(params.get(f"{part}_{other}", 0.0))) for part in ("from", "direct")
                    )
    return matrix


def _inverted_view(axis: AxisModel) -> TimeView:
    """The time view with every effect that it can express; of a skewed loop the bend alone."""
    unskewed = tuple(
        e.model_copy(update={"params": {**e.params, "skew": 0.0}}) if e.name == "asymmetric_hysteresis" else e
        for e in axis.effects
    )
    view = folded(axis.model_copy(update={"effects": unskewed})).time
    assert view is not None
    return view


def _in_order(view: TimeView) -> TimeView:
    plays = [(r, w) for r, w in zip(view.play_r_V, view.play_w_um_per_V, strict=True) if w != 0]
    knots = [(d, s) for d, s in zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True) if s != 0]
    return view.model_copy(
        update={
            "play_r_V": tuple(r for r, _ in plays),
            "play_w_um_per_V": tuple(w for _, w in plays),
            "deadzone_d_V": tuple(d for d, _ in knots),
            "deadzone_s_um_per_V": tuple(s for _, s in knots),
        }
    )


def _least_slope(view: TimeView, limits: Limits) -> tuple[float, float]:
    """Smallest slope within the limits that no play helps, um/V, and the voltage where it begins."""
    if any(w < 0 for w in view.play_w_um_per_V):
        return -1.0, limits.u_min_V
    inside = [d for d in view.deadzone_d_V if limits.u_min_V < d < limits.u_max_V]
    slopes = [(_slope(view, start), start) for start in (limits.u_min_V, *inside)]
    return min(slopes)


def _slope(view: TimeView, v: float) -> float:
    """Above v, without plays."""
    bends = zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True)
    return view.gain_um_per_V + sum(s for d, s in bends if d <= v)


def _reach_um(view: TimeView, limits: Limits) -> tuple[float, float]:
    def position(v: float, side: int) -> float:
        plays = sum(w * (v - side * r) for r, w in zip(view.play_r_V, view.play_w_um_per_V, strict=True))
        bends = zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True)
        return view.offset_um + view.gain_um_per_V * v + plays + sum(s * max(v - d, 0.0) for d, s in bends)

    return position(limits.u_min_V, -1), position(limits.u_max_V, 1)


def _by_name(axis: AxisModel) -> Mapping[str, Params]:
    """Complete parameters of the adopted effects, a load that was added already in the modes."""
    entries = [(effect(adopted.name), _complete(adopted)) for adopted in axis.effects]
    for e, params in tuple(entries):
        if e.rewrite is not None:
            entries = [(other, dict(given)) for other, given in e.rewrite(entries, params)]
    return {e.name: params for e, params in entries}


def _complete(adopted: Effect) -> Params:
    return dict(effect(adopted.name).complete(adopted.params))


def _creep(effects: Mapping[str, Params]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if "creep" not in effects:
        return (), ()
    k, tau_s = terms(effects["creep"])
    if np.abs(k).sum() > 0.5:
        raise BadInput(f"its creep adds {np.abs(k).sum():.3g} of the motion; the device undoes at most half of it")
    if np.min(tau_s, initial=np.inf) < FASTEST_CREEP_s:
        raise BadInput(
            f"its creep has a time constant of {np.min(tau_s):.3g} s; the device undoes {FASTEST_CREEP_s:g} s or more"
        )
    return tuple(map(float, k)), tuple(map(float, tau_s))


def _lowpass(effects: Mapping[str, Params], name: str) -> Undone:
    return undo_lowpass(number(effects[name], "tau_s")) if name in effects else Undone((), 0.0)


def _mechanics(effects: Mapping[str, Params]) -> list[Undone]:
    if "resonance" not in effects:
        return []
    if np.any(np.asarray(effects["resonance"].get("velocity", 0.0)) != 0):
        raise BadInput("its modes are shared with other axes and pass on velocity too, which is not undone")
    return [undo_modes(modes(effects["resonance"]))]


def _refuse_more_than_it_holds(found: Compensation) -> None:
    view = found.view
    for what, count, most in (
        ("plays", len(view.play_r_V), PLAYS),
        ("dead zones", len(view.deadzone_d_V), KNOTS),
        ("creep terms", len(found.creep_k), TERMS),
        ("sections for low-passes and modes", len(found.shape), SECTIONS),
    ):
        if count > most:
            raise BadInput(f"it has {count} {what}, the device holds {most}; fit it with fewer")
    if max(view.play_r_V, default=0.0) > LARGEST_THRESHOLD_V:
        raise BadInput(f"a play of {max(view.play_r_V):g} V; the device holds up to {LARGEST_THRESHOLD_V:g} V")
