"""Lines of the mains in the measured position."""

from __future__ import annotations

import math

import numpy as np

from phaselead.model.axis import AxisModel
from phaselead.model.effects.interface import (
    CheckedParameters,
    Derived,
    Effect,
    Parameter,
    Params,
    Picture,
    Place,
    Samples,
    Scene,
    Signal,
    VirtualAxis,
    columns,
    number,
    with_columns,
)

HARMONICS = (1, 2, 3)
SIZES = tuple(f"{part}{h}_um" for h in HARMONICS for part in ("sin", "cos"))


def apply(signal: Signal, params: Params) -> Samples:
    return with_columns(signal, basis(signal, params), params, *SIZES)


def basis(signal: Signal, params: Params) -> Samples:
    turn = 2 * np.pi * number(params, "f_Hz") * signal.t_s
    sine, cosine = np.sin(turn), np.cos(turn)
    parts, s, c = [sine, cosine], sine, cosine
    for _ in HARMONICS[1:]:
        s, c = s * cosine + c * sine, c * cosine - s * sine
        parts += [s, c]
    return columns(*parts)


def reads(params: Params, axis: AxisModel) -> str:
    nm = [1e3 * math.hypot(number(params, f"sin{h}_um"), number(params, f"cos{h}_um")) for h in HARMONICS]
    f_Hz = number(params, "f_Hz")
    return ", ".join(f"{a:.3g} nm at {h * f_Hz:.5g} Hz" for h, a in zip(HARMONICS, nm, strict=True))


def _amplitude_um(params: Params, scene: Scene) -> float:
    return math.hypot(number(params, "sin1_um"), number(params, "cos1_um"))


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    f_Hz = given.one("f_Hz", above=0.0)
    sines, cosines = ([given.one(f"{part}{h}_um") for h in HARMONICS] for part in ("sin", "cos"))
    axis.lines(f_Hz, sines, cosines)


EFFECT = Effect(
    name="mains_hum",
    listed=190,
    title="Mains hum",
    place=Place.ENVIRONMENT,
    order=1,
    equation="y = x + sum_h sin_h sin(2 pi h f_Hz t) + cos_h cos(2 pi h f_Hz t),  h = 1, 2, 3,  t absolute",
    source="by definition",
    parameters=(
        *(
            Parameter(f"{part}{h}_um", "um", typical, -10.0, 10.0, doc=f"{name} part at {h} times the mains frequency")
            for h, typical in zip(HARMONICS, (0.01, 0.003, 0.003), strict=True)
            for part, name in (("sin", "sine"), ("cos", "cosine"))
        ),
        Parameter("f_Hz", "Hz", 50.0, 45.0, 65.0, role="shape", doc="mains frequency: 50 or 60, within 0.2"),
    ),
    derived=(Derived("amplitude_um", "um", _amplitude_um, doc="amplitude at the mains frequency itself"),),
    shows="narrow lines at 50 or 60 Hz and multiples, in idle as in motion, locked to the clock and not to the path",
    reveals="idle, for longer than the inverse of the wanted resolution",
    confused_with=("vibration",),
    compensation="None in the feed-forward: its phase to the path is not known ahead. A notch in the measurement or "
    "better grounding; learning does not help unless the path is locked to the mains.",
    kind="disturbance",
    apply=apply,
    seen_as="lines",
    picture=Picture("line", {"sin1_um": 0.01, "cos2_um": 0.003, "cos3_um": 0.003}),
    basis=basis,
    reads=reads,
    virtual=virtual,
)
