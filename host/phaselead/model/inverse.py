"""What the device undoes in modes inverse and inverse+pid, from an axis' time view and adopted effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel, Limits, TimeView
from phaselead.model.effects import Entry, Place, effect, modes_in, rewritten
from phaselead.model.level_sections import hold, level, looked_at_Hz
from phaselead.model.operator import with_even_plays
from phaselead.model.sections import PASS, Section
from phaselead.model.sensor_lag import sensor_lag_s
from phaselead.model.stage_file import Stage
from phaselead.record import AXES, Samples

MOST_CREEP = 0.5
"""Sum of what each of its terms adds to the motion."""
PLAYS, KNOTS, TERMS, SECTIONS = 32, 24, 8, 6
"""What the device holds of each (firmware/core)."""
LARGEST_THRESHOLD_V = 64.0
"""Of a play."""
FASTEST_CREEP_s = 0.0007
"""Shortest time constant: the device's filter coefficient for creep, tick over time constant, is at most about 1/4."""
BACKWARDS = (
    "its sensor counts backwards, and the signs of loop and inverse are fixed in the firmware; swap its polarity"
)
LEAST_SLOPE = 2.0**-10
"""um/V; flatter than this the device does not invert."""


@dataclass(frozen=True)
class Compensation:
    """The chain of one axis, undone from its end to its beginning."""

    view: TimeView
    """Plays and dead zones in rising order, those without weight left out; neighbouring plays as one where there are
    more than the device holds."""
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
    view = in_time_view(axis).time
    assert view is not None
    view = _in_order(view)
    if view.gain_um_per_V < 0 and max(view.play_w_um_per_V, default=0.0) <= 0:
        raise BadInput(BACKWARDS)
    least, at_V = _least_slope(view, axis.limits)
    if least < LEAST_SLOPE:
        raise BadInput(
            f"its time view falls or stands still at {at_V:.4g} V ({least:.3g} um/V after a turn), so no voltage "
            "belongs to a position; fit it on records of that range, or narrow its limits"
        )
    view, entries = _few_plays(view), _entries(axis)
    k, tau_s = _creep([e.creep_terms(params) for e, params in entries if e.creep_terms is not None])
    # The drive has room for one section; a further one is put on the position, as linear parts may change places.
    driven = [e.undo_on_drive(params) for e, params in entries if e.undo_on_drive is not None]
    # What acts last is undone first.
    moved = [e.undo_on_position(params) for e, params in _last_first(entries) if e.undo_on_position is not None]
    drive = [section for undone in driven for section in undone.sections]
    shape = (*drive[1:], *(section for undone in moved for section in undone.sections))
    filtered_s = sum(undone.delay_s for undone in [*driven, *moved])
    found = Compensation(
        view, k, tau_s, shape, drive[0] if drive else PASS, view.delay_s + filtered_s, _reach_um(view, axis.limits)
    )
    _refuse_more_than_it_holds(found)
    found = _levelled(found, filtered_s, axis, entries)
    return replace(found, preview_s=max(found.preview_s, 0.0))


def coupling(stage: Stage) -> list[list[float]]:
    """What axis i (row) sees of the motion of axis j, 1 on the diagonal: the stage's matrix and the adopted effects."""
    matrix = [[float(i == j) for j in range(3)] for i in range(3)]
    for i, name in enumerate(AXES):
        for j in range(3):
            if i != j and stage.cross_coupling is not None:
                matrix[i][j] = float(stage.cross_coupling[i][j])
        for e, params in _entries(stage.axes.get(name, AxisModel())):
            for j, other in enumerate(AXES):
                if i != j and e.coupling is not None:
                    matrix[i][j] += e.coupling(params, other)
    return matrix


def in_time_view(axis: AxisModel) -> AxisModel:
    """The axis with what a time view of even plays can express of its effects in its time view; what that cannot
    express of them is dropped, and ``effects`` keeps those of which it can express nothing.

    For inversion and upload: sizes given as a share of the range belong to the range before. Raises BadInput for
    parameters that make no sense.
    """
    if axis.time is None:
        return axis
    view, kept = with_even_plays(axis.time), []
    for adopted in axis.effects:
        e, params = _entry(adopted)
        if e.into_time_view is not None:
            view = e.into_time_view(axis, view, params)
        else:
            kept.append(adopted)
    return axis.model_copy(update={"time": view, "effects": tuple(kept)})


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


def _few_plays(view: TimeView) -> TimeView:
    """No more plays than the device holds, all of positive weight: two neighbours become one between them, which has
    the loop of both in a large swing; those first of which the smaller loops change least."""
    r, w = np.array(view.play_r_V), np.array(view.play_w_um_per_V)
    while len(r) > PLAYS:
        i = int(np.argmin(w[:-1] * w[1:] / (w[:-1] + w[1:]) * np.diff(r)))
        r[i], w[i] = np.average(r[i : i + 2], weights=w[i : i + 2]), w[i] + w[i + 1]
        r, w = np.delete(r, i + 1), np.delete(w, i + 1)
    return view.model_copy(update={"play_r_V": tuple(r.tolist()), "play_w_um_per_V": tuple(w.tolist())})


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


def _entries(axis: AxisModel) -> list[Entry]:
    """The adopted effects with complete parameters in the order of the file, as they change each other (a load that was
    added is already in the modes)."""
    return rewritten([_entry(adopted) for adopted in axis.effects])


def _entry(adopted: AdoptedEffect) -> Entry:
    e = effect(adopted.name)
    return e, e.complete(adopted.params)


def _last_first(entries: Sequence[Entry]) -> list[Entry]:
    """From the end of the physical chain to its beginning."""
    return sorted(entries, key=lambda entry: (-entry[0].place, -entry[0].order))


def _levelled(found: Compensation, filtered_s: float, axis: AxisModel, entries: Sequence[Entry]) -> Compensation:
    """With one more section, where there is room, for what the others leave of modes and low-passes up to near the
    first mode. ``filtered_s``: what filters and sections delay."""
    modes = modes_in(entries)
    lags_s = [e.lag_in_loop_s(params) for e, params in entries if e.lag_in_loop_s is not None]
    if not (found.shape or found.drive is not PASS) or len(found.shape) == SECTIONS:
        return found
    f_Hz = np.array([looked_at_Hz([*(f for _, f, _ in modes), *(1 / (2 * np.pi * tau) for tau in lags_s if tau > 0)])])
    s = 2j * np.pi * f_Hz
    way = hold(f_Hz) * found.shape_response(f_Hz) * found.drive.response(f_Hz) * np.exp(s * filtered_s)
    way *= 1 + sum(c * (1 / (1 + 2 * z * s / (2 * np.pi * f) + (s / (2 * np.pi * f)) ** 2) - 1) for c, f, z in modes)
    for tau_s in lags_s:
        way /= 1 + s * tau_s
    if not any(e.place == Place.SENSOR and e.lag_in_loop_s is not None for e, _ in entries):
        tau_s = sensor_lag_s(axis)  # its delay is in the time view, as a fit has it
        way *= np.exp(s * tau_s) / (1 + s * tau_s)
    section = level(way, float(f_Hz[0]))
    if section is None:
        return found
    return replace(found, shape=(*found.shape, section), preview_s=found.preview_s + section.delay_s)


def _creep(each: Sequence[tuple[Samples, Samples]]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Terms of all of them: what one creeps of the other's creep is small of second order."""
    k = np.concatenate([np.zeros(0), *(k for k, _ in each)])
    tau_s = np.concatenate([np.zeros(0), *(tau_s for _, tau_s in each)])
    if np.abs(k).sum() > MOST_CREEP:
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


def _refuse_more_than_it_holds(found: Compensation) -> None:
    view = found.view
    for what, count, most in (
        ("dead zones", len(view.deadzone_d_V), KNOTS),
        ("creep terms", len(found.creep_k), TERMS),
        ("sections for low-passes and modes", len(found.shape), SECTIONS),
    ):
        if count > most:
            raise BadInput(f"it has {count} {what}, the device holds {most}; fit it with fewer")
    if max(view.play_r_V, default=0.0) > LARGEST_THRESHOLD_V:
        raise BadInput(f"a play of {max(view.play_r_V):g} V; the device holds up to {LARGEST_THRESHOLD_V:g} V")
