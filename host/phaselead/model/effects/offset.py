"""A zero that differs from session to session."""

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


def apply(signal: Signal, params: Params) -> Samples:
    return signal.value + number(params, "offset_um")


def basis(signal: Signal, params: Params) -> Samples:
    return np.ones((len(signal.value), 1))


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    axis.offset(given.one("offset_um"))


def into_time_view(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    return view.model_copy(update={"offset_um": view.offset_um + number(params, "offset_um")})


EFFECT = Effect(
    name="offset",
    listed=160,
    title="Offset",
    place=Place.SENSOR,
    order=1,
    equation="y = x + offset_um",
    source="by definition",
    parameters=(Parameter("offset_um", "um", 1.0, -1000.0, 1000.0, doc="shift of the sensor's zero"),),
    shows="the same distance between model and measurement at all times, voltages and levels",
    reveals="the same record before and after; a session of its own against a frozen reference",
    confused_with=("thermal_drift",),
    compensation="The model's offset is corrected; an integral controller removes what is left.",
    kind="calibration",
    apply=apply,
    moves_zero="at once",
    picture=Picture("sine", {"offset_um": 8.0}),
    basis=basis,
    virtual=virtual,
    repeatable=True,
    into_time_view=into_time_view,
)
