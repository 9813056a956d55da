"""Hysteresis that forgets where it turned."""

from __future__ import annotations

import numpy as np

from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.effects.interface import (
    CheckedParameters,
    Effect,
    Parameter,
    Params,
    Picture,
    Place,
    Samples,
    Signal,
    VirtualAxis,
    numbers,
)
from phaselead.model.fading import (
    ALIKE,
    REVERSIBLE,
    fading_lag_um,
    opening_V,
    plays_alike,
    state_after,
    state_like_plays,
)
from phaselead.model.operator import merged, range_um, rest_position_um, resting_at

MOST = 4
"""Fading plays of one effect."""


def thresholds_and_weights(axis: AxisModel, params: Params) -> tuple[Samples, Samples]:
    """r (m,) in V and w (m,) in um/V."""
    reach, width = numbers(params, "reach"), numbers(params, "width")
    r = reach * _range_V(axis) / 2
    return r, width * range_um(axis) / opening_V(r, _range_V(axis))


def of_weights(r_V: Samples, w_um_per_V: Samples, axis: AxisModel) -> Params:
    """The parameters of fading plays of these thresholds and weights (m,) beside the time view of an axis."""
    width = w_um_per_V * opening_V(r_V, _range_V(axis)) / range_um(axis)
    return {"width": tuple(width.tolist()), "reach": tuple((2 * r_V / _range_V(axis)).tolist())}


def _range_V(axis: AxisModel) -> float:
    low, high = axis.time.u_range_V if axis.time is not None else (axis.limits.u_min_V, axis.limits.u_max_V)
    return high - low


def start(signal: Signal, r: Samples) -> Samples:
    """z (m,) in the first row: at rest, after the known turns, or as where the plays of the time view stand there."""
    view = signal.axis.time
    at_rest = np.full(len(r), -(view.rest_fraction if view is not None else 0.0))
    if signal.plays_V is None or view is None:
        return at_rest
    if signal.turned_V is not None:
        return state_after([0.0, *map(view.field.at, signal.turned_V), float(signal.field_V[0])], r, at_rest)
    lag_V = float(signal.field_V[0]) - signal.start_plays_V
    return np.array([state_like_plays(one, view.play_r_V, lag_V) for one in r])


def apply(signal: Signal, params: Params) -> Samples:
    return signal.value + _added(signal, params)


def basis(signal: Signal, params: Params) -> Samples:
    return _added(signal, {**params, "width": 1.0})[:, None]


def _added(signal: Signal, params: Params) -> Samples:
    """0 at rest."""
    r, w = thresholds_and_weights(signal.axis, params)
    view = signal.axis.time
    at_rest_um = float(w @ r) * (view.rest_fraction if view is not None else 0.0)
    return fading_lag_um(signal.field_V, r, w, start(signal, r)) - at_rest_um


def began_with(signal: Signal, params: Params) -> Samples:
    """What each of the fading plays does longer that had come another way before the first row."""
    r, w = thresholds_and_weights(signal.axis, params)
    v = signal.field_V
    way_V = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(v)))])
    return np.asarray(w * r * np.exp(-way_V[:, None] / (2 * r)))


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    width, reach = given.alike("width", "reach", most=MOST)
    given.positive("reach", reach)
    r, w = thresholds_and_weights(axis.model, {"width": tuple(width), "reach": tuple(reach)})
    axis.fading_plays(r.tolist(), w.tolist())


def into_time_view(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    """Plays that have its steady loops. They remember their turns."""
    r, w = thresholds_and_weights(axis, params)
    each_r = np.concatenate([plays_alike(one) for one in r])
    each_w = (1 - REVERSIBLE) / ALIKE * np.repeat(w, ALIKE)
    plays_r, plays_w = merged(view.play_r_V, view.play_w_um_per_V, each_r, each_w)
    gain = view.gain_um_per_V - (1 - REVERSIBLE) * float(w.sum())
    update = {"gain_um_per_V": gain, "play_r_V": plays_r, "play_w_um_per_V": plays_w}
    return resting_at(view.model_copy(update=update), rest_position_um(view))


def _reads(params: Params, axis: AxisModel) -> str:
    width = float(numbers(params, "width").sum())
    return f"loops that forget where they turned, {100 * width:.2g} % of the range wide"


EFFECT = Effect(
    name="fading_hysteresis",
    listed=12,
    title="Fading hysteresis",
    place=Place.HYSTERESIS,
    order=1,
    equation="y = x - sum_i w_i r_i z_i,  dz_i/d abs(v) = (sign(dv) - z_i) / (2 r_i),  r_i = reach_i U/2,  "
    "2 w_i r_i (1 - 1/cosh(U / 4 r_i)) = width_i X",
    source="Dahl 1976 (friction that comes to its level along the path); Coleman and Hodgdon 1986, the linear one of "
    "their models of ferromagnetic and ferroelectric loops; Padthe, Drincic, Oh, Rizos, Fassois and Bernstein 2008 "
    "(what tells such friction from plays)",
    parameters=(
        Parameter("width", "of range", 0.12, -0.2, 0.6, doc="opening of the full loop at its middle"),
        Parameter("reach", "1", 0.25, 0.01, 1.0, role="shape", log=True, doc="threshold, of half the voltage range"),
    ),
    shows="loops that do not come back to where they turned: a small loop inside a large one drifts until it is "
    "centred, and the way after it does not go on as if it had not been",
    reveals="small loops at several levels, on the way up and on the way down, repeated several times",
    confused_with=("hysteresis", "asymmetric_hysteresis", "creep"),
    compensation="The inverse of plays that have the same steady loops, beside feedback: in open loop the level drifts "
    "by what plays remember and this forgets.",
    apply=apply,
    picture=Picture("loop", {"width": 0.15, "reach": 0.3}),
    basis=basis,
    began_with=began_with,
    virtual=virtual,
    repeatable=True,
    of_base=True,
    from_fading=of_weights,
    into_time_view=into_time_view,
    reads=_reads,
)
