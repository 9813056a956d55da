"""A scale that differs from session to session."""

from __future__ import annotations

import numpy as np

from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.effects.interface import (
    CheckedParameters,
    Effect,
    Parameter,
    Params,
    PartOf,
    Picture,
    Place,
    Samples,
    Signal,
    VirtualAxis,
    number,
)
from phaselead.model.effects.sensor_nonlinearity import WORST
from phaselead.model.operator import rest_position_um, resting_at


def apply(signal: Signal, params: Params) -> Samples:
    return signal.value + number(params, "gain") * signal.displacement_um


def basis(signal: Signal, params: Params) -> Samples:
    return np.asarray(signal.displacement_um)[:, None]


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    axis.sensor_gain(given.one("gain", above=-1.0))


def into_time_view(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    factor = 1 + number(params, "gain")
    update = {
        "gain_um_per_V": factor * view.gain_um_per_V,
        "play_w_um_per_V": tuple(factor * w for w in view.play_w_um_per_V),
        "deadzone_s_um_per_V": tuple(factor * s for s in view.deadzone_s_um_per_V),
    }
    return resting_at(view.model_copy(update=update), rest_position_um(view))


EFFECT = Effect(
    name="gain_change",
    listed=150,
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
    part_of=PartOf("sensor_nonlinearity", up_to=WORST),
    exact=True,
    picture=Picture("sine", {"gain": 0.1}),
    basis=basis,
    virtual=virtual,
    into_time_view=into_time_view,
)
