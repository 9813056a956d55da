"""A scale that differs from session to session."""

from __future__ import annotations

import numpy as np

from phaselead.model.effects.interface import Effect, Parameter, Params, Picture, Place, Samples, Signal, number


def apply(signal: Signal, params: Params) -> Samples:
    return signal.value + number(params, "gain") * signal.displacement_um


def basis(signal: Signal, params: Params) -> Samples:
    return np.asarray(signal.displacement_um)[:, None]


EFFECT = Effect(
    name="gain_change",
    title="Gain change",
    place=Place.SENSOR,
    order=0,
    equation="y = x + gain (x - x_rest)",
    source="by definition",
    parameters=(Parameter("gain", "1", 0.03, -0.9, 2.0, doc="relative change of the scale"),),
    shows="an error in proportion to the displacement, alike at all levels and frequencies",
    reveals="the same record before and after, against a model frozen on the first session",
    confused_with=("softening", "creep"),
    compensation="The gain of the model is corrected, or fed back.",
    kind="calibration",
    apply=apply,
    absorbed_by_modes=True,
    picture=Picture("sine", {"gain": 0.1}),
    basis=basis,
)
