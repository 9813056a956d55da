"""Another load on the stage, a mass or what damps it: modes move or ring for another time, the static gain stays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.errors import BadInput
from phaselead.model.axis import AxisModel
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
    modes_in,
    number,
    numbers,
    rewritten,
)


def apply(signal: Signal, params: Params) -> Samples:
    return signal.value


def rewrite(entries: Sequence[Entry], params: Params) -> Sequence[Entry]:
    """Every mode at constant stiffness, with the mass that it feels and the damping that comes with it."""
    shares = [[share for share, _, _ in effect.modes(given)] if effect.modes else [] for effect, given in entries]
    largest = max((abs(share) for each in shares for share in each), default=0.0)
    mass, damping, others = (number(params, name) for name in ("mass", "damping", "others"))

    def loaded(given: Params, shares: Samples) -> Params:
        felt = _felt(shares, largest, others)
        return _loaded(given, felt * mass, felt * damping)

    return [
        (effect, loaded(given, np.array(each)) if each else given)
        for (effect, given), each in zip(entries, shares, strict=True)
    ]


def _felt(shares: Samples, largest: float, others: float) -> Samples:
    """What part of a load modes with these shares of the motion, each (m,), feel. The ``largest`` share of all modes
    feels all of it; how much others feel depends on how far they move where the load sits."""
    return np.where(np.abs(shares) >= largest, 1.0, others)


def _loaded(params: Params, mass: Samples, damping: Samples) -> Params:
    """The modes (m,) with so much more mass and damping force, each in parts of their own."""
    slower = 1 / np.sqrt(1 + mass)
    was = numbers(params, "zeta")
    zeta = np.minimum(was * (1 + damping) * slower, np.maximum(was, VirtualAxis.LARGEST_ZETA))
    moved = {"f_Hz": numbers(params, "f_Hz") * slower, "zeta": zeta}
    return {**params, **{name: float(v[0]) if np.ndim(params[name]) == 0 else list(v) for name, v in moved.items()}}


def reads(params: Params, axis: AxisModel) -> str:
    from phaselead.model.effects import catalogue  # which imports this module

    known = catalogue()
    before = rewritten([(known[e.name], known[e.name].complete(e.params)) for e in axis.effects if e.name in known])
    pairs = list(zip(modes_in(before), modes_in(rewrite(before, params)), strict=True))
    if not pairs:
        return ""
    (_, was_Hz, was_zeta), (_, now_Hz, now_zeta) = max(pairs, key=lambda pair: abs(pair[0][0]))
    return f"the mode at {was_Hz:.4g} Hz (zeta {was_zeta:.3g}) is at {now_Hz:.4g} Hz ({now_zeta:.3g})"


def untestable(signal: Signal) -> str | None:
    if any(effect.modes for effect, _ in signal.active):
        return None
    return "the model has no resonance that a load could move"


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    mass, damping, others = given.one("mass", above=-1.0), given.one("damping", above=-1.0), given.one("others")
    if not axis.has_modes:
        raise BadInput(f"{given.label} moves a resonance and there is none; add one")
    axis.load(mass, damping, others)


EFFECT = Effect(
    name="load_change",
    listed=70,
    title="Load change",
    place=Place.MECHANICS,
    order=2,
    equation="m -> (1 + mass) m, d -> (1 + damping) d: f_Hz -> f_Hz / sqrt(1 + mass), "
    "zeta -> zeta (1 + damping) / sqrt(1 + mass) of the known mode that carries most of the motion, and with others "
    "mass, others damping of every other known mode; no mode is damped beyond 0.99 by it",
    source="k, m and d of a spring, a mass and a damper; Devasia, Eleftheriou and Moheimani 2007. How far a mode moves "
    "at the place of the load decides how much of it that mode feels: Ewins 2000, Modal testing (mass modification)",
    parameters=(
        Parameter("mass", "of moving mass", 0.1, -0.5, 3.0, doc="mass added to what moves"),
        Parameter(
            "damping",
            "of damping force",
            0.3,
            -0.9,
            10.0,
            doc="damping that comes with it: of a sample, its glue and its leads",
        ),
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
    shows="the peaks of the frequency response move, or grow lower or higher, while the static gain stays",
    reveals="a multisine through the first mode, before and after",
    confused_with=("resonance", "sensor_lowpass"),
    compensation="The notch moves with the mode (new coefficients are uploaded); static tables stay valid.",
    apply=apply,
    picture=Picture("response", {"mass": 0.5}, base="mode"),
    rewrite=rewrite,
    untestable=untestable,
    kind="calibration",
    reads=reads,
    virtual=virtual,
)
