"""A loop whose two ends differ: the even part of hysteresis."""

from __future__ import annotations

import numpy as np

from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.effects.interface import (
    CheckedParameters,
    Derived,
    Effect,
    Parameter,
    Params,
    Picture,
    Place,
    Samples,
    Scene,
    Signal,
    VirtualAxis,
    columns,
    number,
    with_columns,
)
from phaselead.model.operator import CURVE_PIECES, merged, range_um, rest_position_um, resting_at, weighed_plays

PLAYS = 8


def apply(signal: Signal, params: Params) -> Samples:
    return with_columns(signal, basis(signal, params), params, "bend", "skew")


def basis(signal: Signal, params: Params) -> Samples:
    low, high = signal.span_V
    rest = ((low + high) / (high - low)) ** 2
    square = signal.drive_share**2
    r = number(params, "reach") * np.arange(1, PLAYS + 1) / PLAYS
    w = np.full(PLAYS, 1 / (2 * r.sum()))
    lag = weighed_plays(square, r, w, np.full(PLAYS, square[0])) - w.sum() * square
    return columns(signal.range_um * (square - rest), signal.range_um * lag)


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    bend_um, skew_um = given.one("bend") * axis.range_um, given.one("skew") * axis.range_um
    axis.asymmetry(bend_um, skew_um, given.one("reach", above=0.0))


def into_time_view(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    """The parabola as straight pieces through its values at their ends; dead zones know nothing of the skew."""
    assert axis.time is not None
    low, high = axis.time.u_range_V
    knots = np.linspace(low, high, CURVE_PIECES + 1)
    share = np.linspace(-1, 1, CURVE_PIECES + 1)
    slopes = np.diff(number(params, "bend") * range_um(axis) * share**2) / np.diff(knots)
    d, s = merged(view.deadzone_d_V, view.deadzone_s_um_per_V, knots[1:-1], np.diff(slopes))
    gain = view.gain_um_per_V + float(slopes[0])
    update = {"gain_um_per_V": gain, "deadzone_d_V": d, "deadzone_s_um_per_V": s}
    return resting_at(view.model_copy(update=update), rest_position_um(view))


def _bow_um(params: Params, scene: Scene) -> float:
    return number(params, "bend") * range_um(scene.axis)


EFFECT = Effect(
    name="asymmetric_hysteresis",
    listed=20,
    title="Asymmetric hysteresis",
    place=Place.HYSTERESIS,
    order=2,
    equation="y = x + X (bend (q - q_rest) + skew sum_i w (play_ri[q] - q)),  "
    "q = ((v - v_mid) / (U/2))^2,  r_i = reach i/8,  2 w sum r_i = 1",
    source="Kuhnen 2003, eq. 30 (one-sided dead zones, here their smooth sum); Al Janaideh, Rakheja and Su 2009 "
    "(play of an envelope function). Plays with thresholds (r, r(1 - a)) are symmetric plays and a constant: they are "
    "no asymmetry",
    parameters=(
        Parameter("bend", "of range", 0.02, -0.3, 0.3, doc="curvature that both branches share, as a sag at mid-range"),
        Parameter("skew", "of range", 0.01, -0.3, 0.3, doc="loop width that one end has and the other lacks"),
        Parameter(
            "reach",
            "1",
            0.4,
            0.05,
            0.5,
            role="shape",
            log=True,
            may_be_highest=True,  # a larger one would not move within the range
            doc="largest threshold of the skewed plays, in q",
        ),
    ),
    derived=(Derived("bow_um", "um", _bow_um, doc="sag at mid-range from a straight line over the range"),),
    shows="even harmonics that grow as the square of the amplitude; gain and width of equal loops differ with bias",
    reveals="full loops of one size at several biases",
    confused_with=("sensor_nonlinearity", "saturation", "softening"),
    compensation="One-sided dead zones of the time view: their inverse runs in front of the inverse play operator.",
    apply=apply,
    picture=Picture("loop", {"bend": 0.1, "skew": 0.1}),
    basis=basis,
    virtual=virtual,
    into_time_view=into_time_view,
)
