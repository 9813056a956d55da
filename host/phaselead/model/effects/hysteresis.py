"""Hysteresis that the base does not have: a compact Prandtl-Ishlinskii operator."""

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
    columns,
    number,
    with_columns,
)
from phaselead.model.operator import merged, rest_position_um, resting_at, weighed_plays

PLAYS = 10


def distributed(range_V: float, width_um: float, reach: float, slope: float) -> tuple[Samples, Samples]:
    """r (m,) in V and w (m,) in um/V of plays that open a full loop by ``width_um`` at its middle. There a play opens
    by 2 r, and by less where it has not yet turned."""
    steps = np.arange(1, PLAYS + 1) / PLAYS
    r = reach * range_V / 2 * steps
    density = np.exp(slope * steps)
    opening_V = np.minimum(2 * r, range_V - 2 * r)
    return r, width_um * density / float(opening_V @ density)


def thresholds_and_weights(signal: Signal, params: Params) -> tuple[Samples, Samples]:
    """r (m,) in V and w (m,) in um/V."""
    low, high = signal.span_V
    width_um = number(params, "width") * signal.range_um
    return distributed(high - low, width_um, number(params, "reach"), number(params, "slope"))


def lost_um_per_V(signal: Signal, params: Params) -> float:
    """What domain walls that open no loop take off the slope."""
    low, high = signal.span_V
    return number(params, "lost") * signal.range_um / (high - low)


def plays(signal: Signal, params: Params) -> tuple[Samples, Samples, Samples]:
    r, w = thresholds_and_weights(signal, params)
    return r, w, start_V(signal, params, r)


def start_V(signal: Signal, params: Params, r: Samples) -> Samples:
    """Where the plays stand in the first row."""
    return float(signal.field_V[0]) + number(params, "rest_fraction") * r


def apply(signal: Signal, params: Params) -> Samples:
    return with_columns(signal, basis(signal, params), params, "width", "lost")


def basis(signal: Signal, params: Params) -> Samples:
    r, w = thresholds_and_weights(signal, {**params, "width": 1.0})
    v = signal.field_V
    loop = weighed_plays(v, r, w, start_V(signal, params, r)) - float(w.sum()) * v
    flatter = -lost_um_per_V(signal, {"lost": 1.0}) * v
    return columns(loop - number(params, "rest_fraction") * float(w @ r), flatter)


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    width_um = given.one("width") * axis.range_um
    r, w = distributed(axis.range_V, width_um, given.one("reach", above=0.0), given.one("slope"))
    axis.plays(r.tolist(), w.tolist(), (given.one("rest_fraction") * r).tolist())
    axis.slope(-given.one("lost") * axis.range_um / axis.range_V)


def into_time_view(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    """Plays of a view share one rest fraction; those that it has keep theirs."""
    none = np.zeros(1)
    signal = Signal(none, none, none, axis)
    r, w = thresholds_and_weights(signal, params)
    rest = view.rest_fraction if view.play_r_V else number(params, "rest_fraction")
    plays_r, plays_w = merged(view.play_r_V, view.play_w_um_per_V, r, w)
    gain = view.gain_um_per_V - float(w.sum()) - lost_um_per_V(signal, params)
    update = {"gain_um_per_V": gain, "play_r_V": plays_r, "play_w_um_per_V": plays_w, "rest_fraction": rest}
    return resting_at(view.model_copy(update=update), rest_position_um(view))


EFFECT = Effect(
    name="hysteresis",
    listed=10,
    title="Hysteresis",
    place=Place.HYSTERESIS,
    order=0,
    becomes_plays=True,
    equation="y = x + sum_i w_i (play_ri[v] - v) - lost X / U v,  r_i = reach U/2 i/10,  "
    "w_i ~ exp(slope i/10),  sum min(2 r_i, U - 2 r_i) w_i = width X",
    source="Kuhnen 2003, eqs. 5 and 8 (play operator, Prandtl-Ishlinskii superposition). Where a loop "
    "comes from domain walls, those that are pinned take travel off, and those that move back and forth add to it, and "
    "neither opens the loop; in soft ceramics walls make up to 70 % of the motion: Zhang, Wang, Kim and Cross 1994",
    parameters=(
        Parameter("width", "of range", 0.12, -0.2, 0.6, doc="opening of the full loop at its middle"),
        Parameter(
            "lost",
            "of range",
            0.1,
            -0.5,
            0.5,
            absorbed_by_refit=True,
            by_itself="gain_change",
            doc="travel that goes with the loop beside what its plays take off, gained below 0; alone a change of gain",
        ),
        Parameter(
            "reach",
            "1",
            0.5,
            0.02,
            1.0,
            role="shape",
            log=True,
            may_be_highest=True,  # a larger one would not move within the range
            doc="largest threshold, of half the voltage range",
        ),
        Parameter("slope", "1", 0.0, -6.0, 6.0, role="shape", doc="above 0: more of the large thresholds"),
        Parameter(
            "rest_fraction",
            "1",
            0.0,
            -1.0,
            1.0,
            role="shape",
            between_forms=True,
            doc="where the plays stand at rest, of r_i",
        ),
    ),
    shows="a loop of position over voltage that does not close as the frequency falls; odd harmonics; the way back "
    "depends on the last turning points",
    reveals="a slowly decaying triangle, which runs through all minor loops and leaves a known memory",
    confused_with=("delay", "creep", "backlash", "rate_dependence"),
    compensation="The inverse play operator in the feed-forward (mode inverse), or the paper's gain and phase tables "
    "for periodic paths.",
    apply=apply,
    picture=Picture("loop", {"width": 0.15, "reach": 0.6}),
    basis=basis,
    plays=plays,
    virtual=virtual,
    repeatable=True,
    into_time_view=into_time_view,
)
