"""Modes of the mechanics."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from phaselead.errors import BadInput
from phaselead.model.axis import AxisModel
from phaselead.model.effects.filters import Mode, behind_modes, resonant
from phaselead.model.effects.interface import (
    STOOD_OFF,
    CheckedParameters,
    Effect,
    InPlaceOf,
    Parameter,
    Params,
    Picture,
    Place,
    Samples,
    Signal,
    VirtualAxis,
    columns,
    numbers,
)
from phaselead.model.effects.mode_bank import NOT_PLAYED, poles, state_weights, states
from phaselead.model.effects.softening import mode_levels
from phaselead.model.effects.virtual import MOST_POLES
from phaselead.model.operator import range_um
from phaselead.model.sections import Undone, undo_modes


def modes(params: Params) -> list[Mode]:
    """(c, f_Hz, zeta) of every mode. A single mode without c carries all of the motion. Raises BadInput."""
    f_Hz, zeta = numbers(params, "f_Hz"), numbers(params, "zeta")
    c = numbers(params, "c") if "c" in params else np.ones(1)
    if not len(c) == len(f_Hz) == len(zeta):
        raise BadInput(
            f"effect 'resonance': c, f_Hz and zeta have {len(c)}, {len(f_Hz)} and {len(zeta)} elements; "
            "give one of each per mode"
        )
    if not ((f_Hz > 0).all() and (zeta > 0).all()):
        raise BadInput("effect 'resonance': f_Hz and zeta must be above 0")
    return [(float(a), float(f), float(z)) for a, f, z in zip(c, f_Hz, zeta, strict=True)]


def from_modes(found: Sequence[Mode]) -> dict[str, float | tuple[float, ...]]:
    """A single mode that carries all of the motion needs no c."""
    c, f_Hz, zeta = zip(*found, strict=True)
    if c == (1.0,):
        return {"f_Hz": f_Hz[0], "zeta": zeta[0]}
    return {"c": c, "f_Hz": f_Hz, "zeta": zeta}


def apply(signal: Signal, params: Params) -> Samples:
    if "velocity" in params:
        return _shared_modes(signal, params)
    return behind_modes(signal.value, modes(params), signal.step_s)


def _shared_modes(signal: Signal, params: Params) -> Samples:
    """All modes in one pass, with what moves in proportion to velocity, and with poles that fall with the level."""
    own = np.array(modes(params))
    velocity = numbers(params, "velocity")
    if len(velocity) != len(own):
        raise BadInput(
            f"effect 'resonance': {len(own)} modes but {len(velocity)} of velocity; give one of each per mode"
        )
    c, f_Hz, zeta = own.T
    level, drop = mode_levels(signal, zeta)
    moved = signal.displacement_um
    through = states(moved, poles(f_Hz, zeta), signal.step_s, level, drop) @ state_weights(c, velocity, zeta)
    return np.asarray(signal.value - c.sum() * moved + through)


def basis(signal: Signal, params: Params) -> Samples:
    return columns(*(resonant(signal.value, f, zeta, signal.step_s) - signal.value for _, f, zeta in modes(params)))


def before_record(since_s: Samples, params: Params, axis: AxisModel) -> Samples:
    """What rings of a step that each mode was given before, a quarter of a turn apart."""
    found = []
    for c, f_Hz, zeta in modes(params):
        turn = 2 * np.pi * f_Hz * since_s
        ringing = abs(c) * STOOD_OFF * range_um(axis) * np.exp((1j * np.sqrt(1 - zeta**2) - zeta) * turn)
        found += [ringing.real, ringing.imag]
    return np.stack(found, axis=1)


def normalise(params: Params) -> Params:
    return {"c": 1.0, **params} if "f_Hz" in params and np.ndim(params["f_Hz"]) == 0 else params


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    if "velocity" in given:
        raise BadInput(f"{given.label} has {NOT_PLAYED}")
    f_Hz, zeta, c = given.alike("f_Hz", "zeta", "c", most=MOST_POLES)
    given.positive("f_Hz", f_Hz)
    given.positive("zeta", zeta, below=1.0)
    axis.modes(c, f_Hz, zeta)


def from_a_known_mode(params: Params, known: Sequence[Mode]) -> float:
    """How far the zeros of a mode are above the nearest of the modes that the model has: where they meet, they take
    that mode away, and this one stands in its place. Of several modes the nearest counts; a mode that carries all of
    the motion has no zeros."""
    zeros_Hz = [f_Hz / math.sqrt(1 - c) for c, f_Hz, _ in modes(params) if c < 1]
    apart = [math.log(zero_Hz / one_Hz) for zero_Hz in zeros_Hz for _, one_Hz, _ in known]
    return min(apart, key=abs, default=math.inf)


def undo_on_position(params: Params) -> Undone:
    if np.any(np.asarray(params.get("velocity", 0.0)) != 0):
        raise BadInput("its modes are shared with other axes and pass on velocity too, which is not undone")
    return undo_modes(modes(params))


EFFECT = Effect(
    name="resonance",
    listed=60,
    title="Resonance",
    place=Place.MECHANICS,
    order=1,
    peak=("f_Hz", "zeta"),
    at_once=lambda params: "velocity" not in params,
    equation="y = (1 - c) x + c w^2 x / (s^2 + 2 zeta w s + w^2),  w = 2 pi f_Hz; the static gain stays 1",
    source="Devasia, Eleftheriou and Moheimani 2007, A survey of control issues in nanopositioning. Lists of c, f_Hz "
    "and zeta are several modes; beside them `velocity`, a list too, adds velocity w s x / (s^2 + 2 zeta w s + w^2) "
    "for modes that the axes share (Gawronski 2004, Advanced structural dynamics, section 2.3: complex modes)",
    parameters=(
        Parameter("c", "1", 1.0, -2.0, 2.0, doc="share of the static motion that this mode carries"),
        Parameter("f_Hz", "Hz", 200.0, 10.0, 5000.0, role="shape", log=True, doc="undamped natural frequency"),
        Parameter("zeta", "1", 0.02, 0.002, 0.5, role="shape", log=True, doc="damping ratio"),
    ),
    shows="a peak with a phase drop of 180 degrees in the frequency response, ringing after steps and corners",
    reveals="a multisine through the peak, or steps, sampled at least five times faster than the mode",
    confused_with=("load_change", "delay", "amplifier_lowpass"),
    compensation="A notch at the mode (biquad cascade) in the feed-forward, or a reference without its harmonics; the "
    "notch follows f_Hz, so a changed load needs a new fit.",
    apply=apply,
    shared_modes="own path",
    in_place_of=InPlaceOf("load_change", from_a_known_mode),
    picture=Picture("response", {"c": 1.0, "f_Hz": 200.0, "zeta": 0.02}),
    basis=basis,
    before_record=before_record,
    accepts=("velocity",),
    normalise=normalise,
    modes=modes,
    from_modes=from_modes,
    virtual=virtual,
    repeatable=True,
    undo_on_position=undo_on_position,
)
