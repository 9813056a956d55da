"""Compliance that grows with the recent level of motion."""

from __future__ import annotations

import numpy as np

from phaselead.effects.effect import Effect, Parameter, Params, Picture, Place, Samples, Signal, number
from phaselead.effects.filters import relaxed


def apply(signal: Signal, params: Params) -> Samples:
    return signal.value + number(params, "kappa") * _column(signal, params)


def basis(signal: Signal, params: Params) -> Samples:
    return _column(signal, params)[:, None]


def _column(signal: Signal, params: Params) -> Samples:
    tau_s, about_mean = number(params, "tau_s"), number(params, "about_mean")
    z = signal.displacement_um / signal.range_um
    if about_mean:
        z = z - about_mean * relaxed(z, tau_s, signal.step_s)
    level = relaxed(z**2, tau_s, signal.step_s)
    return np.asarray(signal.range_um * z * np.sqrt(np.maximum(level, 0.0)))


EFFECT = Effect(
    name="softening",
    title="Softening",
    place=Place.HYSTERESIS,
    order=3,
    equation="y = x + kappa X z sqrt(e),  tau_s de/dt = z^2 - e,  z = (x - x_rest)/X less "
    "about_mean times its slow mean",
    source="Damjanovic 1998 (Rayleigh law: the piezo coefficient grows with the amplitude of the field), "
    "with a recent level instead of the amplitude",
    parameters=(
        Parameter("kappa", "1", 0.15, -2.0, 2.0, doc="relative growth of the gain at a level (rms) of the whole range"),
        Parameter("tau_s", "s", 0.5, 0.02, 100.0, role="shape", log=True, doc="memory of the level"),
        Parameter(
            "about_mean", "1", 0.0, 0.0, 1.0, role="shape", doc="0: level counts from rest; 1: from the recent mean"
        ),
    ),
    shows="the gain rises by 3-6 % with the drive level and modes fall a little; odd, but it follows the level slowly",
    reveals="one multisine at several levels, each long enough for the level to settle",
    confused_with=("gain_change", "creep", "rate_dependence", "hysteresis"),
    compensation="The gain of the feed-forward can be scheduled with the level of a periodic path; the controller does "
    "not do that by itself, its feedback takes it up.",
    apply=apply,
    picture=Picture("level", {"kappa": 0.15}),
    basis=basis,
    compensated=False,
)
