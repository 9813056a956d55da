"""Slack in the transmission."""

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
    width = number(params, "width")
    if width <= 0:
        return signal.value
    r = width * signal.range_um / 2
    return weighed_plays(signal.value, [r], [1.0], [float(signal.value[0])])


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    axis.slack(given.one("width", low=0.0) * axis.range_um / 2)


EFFECT = Effect(
    name="backlash",
    listed=220,
    title="Backlash",
    place=Place.MECHANICS,
    order=0,
    equation="y = play_r[x],  2 r = width X",
    source="Nordin and Gutman 2002, Controlling mechanical systems with backlash",
    parameters=(Parameter("width", "of range", 0.002, 0.0, 0.3, log=True, doc="slack from one flank to the other"),),
    shows="after every reversal a hold of one size, whatever the amplitude; amplitudes below it vanish",
    reveals="reversals much smaller than the smallest threshold of the hysteresis",
    confused_with=("hysteresis",),
    compensation="None: its inverse is a jump by the width at each reversal, which no amplifier follows. Where it is "
    "worth it, a refit takes it up as one more play, and the inverse play operator then knows it.",
    apply=apply,
    picture=Picture("loop", {"width": 0.1}),
    virtual=virtual,
    repeatable=True,
)
