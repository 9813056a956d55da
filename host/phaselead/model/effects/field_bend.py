"""A field that rises unevenly with the voltage: all of the hysteresis answers to it."""

from __future__ import annotations

import numpy as np

from phaselead.errors import BadInput
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
    number,
)
from phaselead.model.field import Field
from phaselead.model.operator import rest_position_um, resting_at

MOST = 0.2
"""The slope of the field changes from 0.6 to 1.4 over the span then, or back."""
PIECES = 20
"""Straight pieces of the curve of a time view, as many as a fit has at most: within 0.3 % of the size of the bend."""


def field(params: Params, axis: AxisModel) -> Field:
    assert axis.time is not None
    return Field(number(params, "bend"), axis.time.u_range_V)


def of_field(bent: Field) -> Params:
    """The parameters of a field."""
    return {"bend": bent.bend}


def apply(signal: Signal, params: Params) -> Samples:
    return Field(number(params, "bend"), signal.span_V).of(signal.value)


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    """The parabola about 0 V; beyond the span it goes on as one."""
    bend = given.one("bend", low=-MOST, below=MOST)
    low, high = axis.span_V
    steep = 1 - 2 * bend * (low + high) / (high - low)
    if not steep > 0:
        raise BadInput(f"{given.label}: the field falls at 0 V, far from the voltages of the fit; lower bend")
    axis.filter(steep, [], [])
    axis.stiffness(2 * bend / (high - low) * axis.range_um / steep**2, 0.0)


def into_time_view(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    """The curve without memory that view and field have together where all plays move, as straight pieces. After a turn
    plays that stand still do not feel the bend, which a time view cannot say; so that it rises there as well, the bend
    takes no more than half of the slope that is left then."""
    low, high = view.u_range_V
    knots = np.linspace(low, high, PIECES + 1)
    asked, felt = np.diff(knots), np.diff(field(params, axis).of(knots))
    own = np.diff(_without_plays_um(view, field(params, axis).of(knots))) / asked
    slopes = own + sum(view.play_w_um_per_V) * (felt / asked - 1)
    slopes = np.where(own > 0, np.maximum(slopes, own / 2), slopes)
    update = {
        "gain_um_per_V": float(slopes[0]),
        "deadzone_d_V": tuple(knots[1:-1].tolist()),
        "deadzone_s_um_per_V": tuple(np.diff(slopes).tolist()),
    }
    return resting_at(view.model_copy(update=update), rest_position_um(view))


def _without_plays_um(view: TimeView, v: Samples) -> Samples:
    """(n,) at voltages (n,) of the field."""
    bends = zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True)
    return np.asarray(view.gain_um_per_V * v + sum(s * np.maximum(v - d, 0.0) for d, s in bends))


def whole_in_time_view(params: Params) -> bool:
    return not number(params, "bend")


def _reads(params: Params, axis: AxisModel) -> str:
    bend = number(params, "bend")
    return (
        f"a field that rises {1 - 2 * bend:.2g} times as fast at one end of the range, {1 + 2 * bend:.2g} at the other"
    )


EFFECT = Effect(
    name="field_bend",
    listed=14,
    title="Bend of the field",
    place=Place.AMPLIFIER,
    order=9,
    equation="v' = v + bend (U/2) (s^2 - s_0^2),  s = (v - v_mid) / (U/2), s_0 that of 0 V; straight on beyond U",
    source="Al Janaideh, Rakheja and Su 2009 (plays of an envelope function of the voltage, here a parabola)",
    parameters=(
        Parameter("bend", "of half the voltage range", 0.05, -MOST, MOST, doc="how far the middle of the range lags"),
    ),
    shows="loops of one width in volts that are wider in micrometres at one end of the range than at the other, and "
    "steeper there",
    reveals="small loops at several levels beside one over the whole range",
    confused_with=("asymmetric_hysteresis", "sensor_nonlinearity", "dac_nonlinearity"),
    compensation="The inverse of the curve that it gives a full loop; what small loops feel less of it is left to "
    "feedback.",
    apply=apply,
    picture=Picture("loop", {"bend": 0.15}, base="plays"),
    virtual=virtual,
    of_base=True,
    field=field,
    of_field=of_field,
    into_time_view=into_time_view,
    whole_in_time_view=whole_in_time_view,
    reads=_reads,
)
