"""A field that rises unevenly with the voltage: all of the hysteresis answers to it."""

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
    number,
)
from phaselead.model.field import Field
from phaselead.model.operator import merged, rest_position_um, resting_at

MOST = 0.2
"""The slope of the field changes from 0.6 to 1.4 over the span then, or back."""
PIECES = 10
"""Straight pieces that the curve is drawn with in a time view: within 0.3 % of its size."""


def field(params: Params, axis: AxisModel) -> Field:
    assert axis.time is not None
    return Field(number(params, "bend"), axis.time.u_range_V)


def of_field(bent: Field) -> Params:
    """The parameters of a field."""
    return {"bend": bent.bend}


def apply(signal: Signal, params: Params) -> Samples:
    return Field(number(params, "bend"), signal.span_V).at(signal.value)


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    bend = given.one("bend", above=-0.5, below=0.5)
    low, high = axis.span_V
    steep = 1 - 2 * bend * (low + high) / (high - low)
    axis.filter(steep, [], [])
    axis.stiffness(2 * bend / (high - low) * axis.range_um / steep**2, 0.0)


def into_time_view(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    """What the bend does where all plays move, as straight pieces through its values at their ends: it then bends the
    position as it bends the field. After a turn plays that stand still do not feel it, which a time view cannot say; so
    that it rises there as well, no piece takes more than half of the slope without plays."""
    low, high = view.u_range_V
    slope = view.gain_um_per_V + sum(view.play_w_um_per_V) + sum(view.deadzone_s_um_per_V) / 2
    knots = np.linspace(low, high, PIECES + 1)
    slopes = slope * (np.diff(field(params, axis).at(knots)) / np.diff(knots) - 1)
    slopes = np.maximum(slopes, -abs(view.gain_um_per_V) / 2) if slope > 0 else slopes
    d, s = merged(view.deadzone_d_V, view.deadzone_s_um_per_V, knots[1:-1], np.diff(slopes))
    update = {"gain_um_per_V": view.gain_um_per_V + float(slopes[0]), "deadzone_d_V": d, "deadzone_s_um_per_V": s}
    return resting_at(view.model_copy(update=update), rest_position_um(view))


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
    equation="v' = v + bend (v^2 - 2 v_mid v) / (U/2)",
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
