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
    """Every mode at constant stiffness and damping force, with the mass that it feels."""
    shares = [[share for share, _, _ in effect.modes(given)] if effect.modes else [] for effect, given in entries]
    largest = max((abs(share) for each in shares for share in each), default=0.0)
    mass, others = number(params, "mass"), number(params, "others")
    return [
        (effect, _loaded(given, _felt_mass(np.array(each), largest, mass, others)) if each else given)
        for (effect, given), each in zip(entries, shares, strict=True)
    ]


def _felt_mass(shares: Samples, largest: float, mass: float, others: float) -> Samples:
    """Of modes with these shares of the motion, each (m,), in parts of their own mass. The ``largest`` share of all
    modes feels all of the mass; how much others feel depends on how far they move where the load sits."""
    return np.where(np.abs(shares) >= largest, mass, others * mass)


def _loaded(params: Params, felt: Samples) -> Params:
    moved = {name: numbers(params, name) / np.sqrt(1 + felt) for name in ("f_Hz", "zeta")}
    return {**params, **{name: float(v[0]) if np.ndim(params[name]) == 0 else list(v) for name, v in moved.items()}}


def untestable(signal: Signal) -> str | None:
    if any(effect.modes for effect, _ in signal.active):
        return None
    return "the model has no resonance that a load could move"


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    mass, others = given.one("mass", above=-1.0), given.one("others")
    if not axis.has_modes:
        raise BadInput(f"{given.label} moves a resonance and there is none; add one")
    axis.load(mass, others)


EFFECT = Effect(
    name="load_change",
    listed=70,
    title="Load change",
    place=Place.MECHANICS,
    order=2,
    equation="m -> (1 + mass) m: f_Hz -> f_Hz / sqrt(1 + mass), zeta -> zeta / sqrt(1 + mass) of the known mode that "
    "carries most of the motion, and with others mass of every other known mode",
    source="k/m of a spring and a mass; Devasia, Eleftheriou and Moheimani 2007. How far a mode moves at the place of "
    "the load decides how much of it that mode feels: Ewins 2000, Modal testing (mass modification)",
    parameters=(
        Parameter("mass", "of moving mass", 0.1, -0.5, 3.0, doc="mass added to what moves"),
        Parameter(
            "others",
            "1",
            1.0,
            0.0,
            1.0,
            role="shape",
            between_forms=True,
            needs_modes=2,
            doc="how much of it the smaller modes feel: 0 where the load sits at a node of theirs, 1 all of it",
        ),
    ),
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
