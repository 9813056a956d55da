"""A dead band of fixed size in the driving voltage."""

from __future__ import annotations

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
from phaselead.model.operator import weighed_plays


def apply(signal: Signal, params: Params) -> Samples:
    width_V = number(params, "width_V")
    if width_V <= 0:
        return signal.value
    return weighed_plays(signal.value, [width_V / 2], [1.0], [float(signal.value[0])])


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    axis.slack(given.one("width_V", low=0.0) / 2)


EFFECT = Effect(
    name="dead_band",
    title="Dead band",
    place=Place.AMPLIFIER,
    order=4,
    equation="v' = play_r[v],  2 r = width_V: the actuator follows with the voltage r behind, the same at every level",
    source="Tao and Kokotovic 1996, Adaptive Control of Systems with Actuator and Sensor Nonlinearities (actuator "
    "backlash); of a ceramic, the field below which no domain wall moves (Damjanovic 1998)",
    parameters=(
        Parameter("width_V", "V", 0.005, 0.0, 0.5, log=True, doc="voltage from following one way to following back"),
    ),
    shows="small drives lose gain and gain phase, large ones do not: what is missing has one size in volts",
    reveals="one multisine at several levels down to a few times the width; tiny reversals",
    confused_with=("backlash", "hysteresis", "softening"),
    hard_to_tell_from=("rate_dependence",),
    alone_as="backlash",
    compensation="None: its inverse is a jump by the width at each reversal, which no amplifier follows.",
    apply=apply,
    picture=Picture("loop", {"width_V": 1.0}),
    virtual=virtual,
    repeatable=True,
)
