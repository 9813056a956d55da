"""Compliance that grows with the recent level of motion."""

from __future__ import annotations

import numpy as np

from phaselead.errors import BadInput
from phaselead.model.axis import AxisModel
from phaselead.model.effects.filters import relaxed
from phaselead.model.effects.interface import (
    STOOD_OFF,
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
    numbers,
)
from phaselead.model.effects.mode_bank import Complex
from phaselead.model.operator import range_um


def apply(signal: Signal, params: Params) -> Samples:
    return signal.value + number(params, "kappa") * _column(signal, params)


def basis(signal: Signal, params: Params) -> Samples:
    return _column(signal, params)[:, None]


def _column(signal: Signal, params: Params) -> Samples:
    z = _strain(signal, params)
    return np.asarray(signal.range_um * z * _level(z, params, signal.step_s))


def _strain(signal: Signal, params: Params) -> Samples:
    """z (n,): displacement as a share of the range."""
    z = signal.displacement_um / signal.range_um
    about_mean = number(params, "about_mean")
    return np.asarray(z - about_mean * relaxed(z, number(params, "tau_s"), signal.step_s) if about_mean else z)


def _level(z: Samples, params: Params, step_s: float) -> Samples:
    """sqrt(e)^exponent (n,)."""
    square = np.maximum(relaxed(z**2, number(params, "tau_s"), step_s), 0.0)
    return np.asarray(square ** (number(params, "exponent") / 2))


def push_level(push: Signal, params: Params) -> Samples:
    """sqrt(e)^exponent (n,) of an actuator, from what it gives to the mechanics."""
    return _level(_strain(push, params), params, push.step_s)


def mode_levels(signal: Signal, zeta: Samples) -> tuple[Samples | None, Complex | None]:
    """Levels (n, k) of the actuators whose softening moves modes, and by how much (m, k): pole r becomes
    p_r (1 - sum drop_rk level_k). None without any. Raises BadInput when the lists do not fit the modes (m,)."""
    levels, drops = [], []
    for push in signal.pushes.values() or [signal]:
        for effect, params in push.active:
            if effect.name == EFFECT.name and "f_drop" in params:
                levels.append(push_level(push, params))
                drops.append(_drop(params, zeta))
    return (np.stack(levels, axis=1), np.stack(drops, axis=1)) if levels else (None, None)


def _drop(params: Params, zeta: Samples) -> Complex:
    """(m,). A turn of the pole by an angle changes zeta by its sine: zeta = -cos(angle)."""
    f_drop, zeta_rise = numbers(params, "f_drop"), numbers(params, "zeta_rise")
    if not len(f_drop) == len(zeta_rise) == len(zeta):
        raise BadInput(
            f"effect 'softening': f_drop and zeta_rise have {len(f_drop)} and {len(zeta_rise)} elements for "
            f"{len(zeta)} modes; give one of each per mode of the resonance"
        )
    return np.asarray(f_drop - 1j * zeta_rise / np.sqrt(1 - zeta**2))


def normalise(params: Params) -> Params:
    return {"kappa": 0.0, **{p.name: p.typical for p in EFFECT.shapes}, **params}


def before_record(since_s: Samples, params: Params, axis: AxisModel) -> Samples:
    away_um = STOOD_OFF * range_um(axis) * STOOD_OFF * number(params, "kappa")
    return np.asarray(away_um * np.exp(-since_s / number(params, "tau_s"))[:, None])


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    tau_s, exponent = given.one("tau_s", above=0.0), given.one("exponent", above=0.0)
    axis.level_gain(given.one("kappa"), tau_s, given.one("about_mean"), exponent)


EFFECT = Effect(
    name="softening",
    listed=40,
    title="Softening",
    place=Place.HYSTERESIS,
    order=4,
    equation="y = x + kappa X z L,  L = sqrt(e)^exponent,  tau_s de/dt = z^2 - e,  z = (x - x_rest)/X less "
    "about_mean times its slow mean",
    source="Damjanovic 1998 (Rayleigh law: the piezo coefficient grows with the amplitude of the field, exponent 1; "
    "pinning of unequal depth gives other powers), with a recent level instead of the amplitude. The lists f_drop and "
    "zeta_rise move the modes of the resonance: f_Hz (1 - f_drop L), zeta + zeta_rise L, with L of what the actuator "
    "gives to the mechanics",
    parameters=(
        Parameter("kappa", "1", 0.15, -2.0, 2.0, doc="relative growth of the gain at a level (rms) of the whole range"),
        Parameter("tau_s", "s", 0.5, 0.02, 100.0, role="shape", log=True, doc="memory of the level"),
        Parameter(
            "about_mean",
            "1",
            0.0,
            0.0,
            1.0,
            role="shape",
            between_forms=True,
            doc="0: level counts from rest; 1: from the recent mean",
        ),
        Parameter("exponent", "1", 1.0, 0.5, 2.0, role="shape", log=True, doc="power of the level; 1: Rayleigh's law"),
    ),
    shows="the gain rises by 3-6 % with the drive level and modes fall a little; odd, but it follows the level slowly",
    reveals="one multisine at several levels, each long enough for the level to settle",
    confused_with=("gain_change", "creep", "rate_dependence", "hysteresis"),
    compensation="The gain of the feed-forward can be scheduled with the level of a periodic path; the controller does "
    "not do that by itself, its feedback takes it up.",
    apply=apply,
    shared_modes="level",
    picture=Picture("level", {"kappa": 0.15}),
    basis=basis,
    accepts=("f_drop", "zeta_rise"),
    normalise=normalise,
    before_record=before_record,
    virtual=virtual,
    repeatable=True,
)
