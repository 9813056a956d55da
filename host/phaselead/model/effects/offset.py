"""A zero that differs from session to session."""

from __future__ import annotations

import numpy as np

from phaselead.model.effects.interface import Effect, Parameter, Params, Picture, Place, Samples, Signal, number


def apply(signal: Signal, params: Params) -> Samples:
    return signal.value + number(params, "offset_um")


def basis(signal: Signal, params: Params) -> Samples:
    return np.ones((len(signal.value), 1))


EFFECT = Effect(
    name="offset",
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
)
