"""What the device undoes in modes inverse and inverse+pid, from an axis' time view and adopted effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel, Limits, TimeView
from phaselead.model.effects import effect
from phaselead.model.effects.creep import terms
from phaselead.model.effects.interface import Params, Samples, number
from phaselead.model.effects.resonance import modes
from phaselead.model.folded import folded
from phaselead.model.sections import PASS, Section, Undone, undo_lowpass, undo_modes
from phaselead.model.stage_file import Stage

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
    k, tau_s = _creep(effects.get("creep", ()))
    # The drive has room for one section; a further low-pass of the amplifier is undone on the position, as linear parts
    # may change places.
    amplifiers = [undo_lowpass(number(params, "tau_s")) for params in effects.get("amplifier_lowpass", ())]
    sensors = [undo_lowpass(number(params, "tau_s")) for params in effects.get("sensor_lowpass", ())]
    drive = [section for undone in amplifiers for section in undone.sections]
    before = [*sensors, *_mechanics(effects.get("resonance", ()))]
    shape = (*drive[1:], *(section for undone in before for section in undone.sections))
    preview_s = view.delay_s + sum(undone.delay_s for undone in [*amplifiers, *before])
    found = Compensation(
        view, k, tau_s, shape, drive[0] if drive else PASS, max(preview_s, 0.0), _reach_um(view, axis.limits)
    )
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
            for params, (j, other) in product(_by_name(stage.axes[name]).get("cross_coupling", ()), enumerate(names)):
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


def _by_name(axis: AxisModel) -> Mapping[str, Sequence[Params]]:
    """Complete parameters of the adopted effects, a load that was added already in the modes. An effect may be there
    more than once: each acts."""
    entries = [(effect(adopted.name), _complete(adopted)) for adopted in axis.effects]
    for e, params in tuple(entries):
        if e.rewrite is not None:
            entries = [(other, dict(given)) for other, given in e.rewrite(entries, params)]
    found: dict[str, list[Params]] = {}
    for e, params in entries:
        found.setdefault(e.name, []).append(params)
    return found


def _complete(adopted: AdoptedEffect) -> Params:
    return dict(effect(adopted.name).complete(adopted.params))


def _creep(given: Sequence[Params]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Terms of all of them: what one creeps of the other's creep is small of second order."""
    each = [terms(params) for params in given]
    k = np.concatenate([np.zeros(0), *(k for k, _ in each)])
    tau_s = np.concatenate([np.zeros(0), *(tau_s for _, tau_s in each)])
    if np.abs(k).sum() > 0.5:
        raise BadInput(f"its creep adds {np.abs(k).sum():.3g} of the motion; the device undoes at most half of it")
    if np.min(tau_s, initial=np.inf) < FASTEST_CREEP_s:
        raise BadInput(
            f"its creep has a time constant of {np.min(tau_s):.3g} s; the device undoes {FASTEST_CREEP_s:g} s or more"
        )
    if len(k) > TERMS:
        k, tau_s = _fewer_terms(k, tau_s)
    return tuple(map(float, k)), tuple(map(float, tau_s))


def _fewer_terms(k: Samples, tau_s: Samples) -> tuple[Samples, Samples]:
    """As many as the device holds, of the same answer to a step from the fastest to the slowest by least squares."""
    kept_s = np.geomspace(tau_s.min(), tau_s.max(), TERMS)
    t_s = np.geomspace(0.1 * tau_s.min(), 10 * tau_s.max(), 40 * TERMS)
    decays = np.exp(-t_s[:, None] / kept_s)
    kept, *_ = np.linalg.lstsq(decays, np.exp(-t_s[:, None] / tau_s) @ k, rcond=1e-9)
    return np.asarray(kept), kept_s


def _mechanics(given: Sequence[Params]) -> list[Undone]:
    if any(np.any(np.asarray(params.get("velocity", 0.0)) != 0) for params in given):
        raise BadInput("its modes are shared with other axes and pass on velocity too, which is not undone")
    return [undo_modes(modes(params)) for params in given]


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
