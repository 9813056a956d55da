"""Another mass on the stage: its modes move, its static gain does not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.errors import BadInput
from phaselead.model.effects.interface import (
    CheckedParameters,
    Effect,
    Entry,
    Parameter,
    Params,
    Picture,
    Place,
    Samples,
    Signal,
    VirtualAxis,
    number,
    numbers,
)


def apply(signal: Signal, params: Params) -> Samples:
    return signal.value


def rewrite(entries: Sequence[Entry], params: Params) -> Sequence[Entry]:
    """Every mode at constant stiffness and damping force with the mass multiplied by 1 + mass."""
    factor = (1 + number(params, "mass")) ** -0.5
    return [(effect, _loaded(given, factor) if effect.modes else given) for effect, given in entries]


def _loaded(params: Params, factor: float) -> Params:
    moved = {name: numbers(params, name) * factor for name in ("f_Hz", "zeta")}
    return {**params, **{name: float(v[0]) if np.ndim(params[name]) == 0 else list(v) for name, v in moved.items()}}


def untestable(signal: Signal) -> str | None:
    if any(effect.modes for effect, _ in signal.active):
        return None
    return "the model has no resonance that a load could move"


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    mass = given.one("mass", above=-1.0)
    if not axis.has_modes:
        raise BadInput(f"{given.label} moves a resonance and there is none; add one")
    axis.load(mass)


EFFECT = Effect(
    name="load_change",
    listed=70,
    title="Load change",
    place=Place.MECHANICS,
    order=2,
    equation="m -> (1 + mass) m: f_Hz -> f_Hz / sqrt(1 + mass), zeta -> zeta / sqrt(1 + mass) of every known mode",
    source="k/m of a spring and a mass; Devasia, Eleftheriou and Moheimani 2007",
    parameters=(Parameter("mass", "of moving mass", 0.1, -0.5, 3.0, doc="mass added to what moves"),),
    shows="the peaks of the frequency response move while the static gain stays",
    reveals="a multisine through the first mode, before and after",
    confused_with=("resonance", "sensor_lowpass"),
    compensation="The notch moves with the mode (new coefficients are uploaded); static tables stay valid.",
    apply=apply,
    picture=Picture("response", {"mass": 0.5}, base="mode"),
    rewrite=rewrite,
    untestable=untestable,
    kind="calibration",
    virtual=virtual,
)
