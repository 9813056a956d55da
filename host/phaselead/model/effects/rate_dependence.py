"""Friction whose level depends on the speed: a loop that widens or narrows with the rate."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from phaselead.compiled import kernel_of
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
    columns,
    number,
    with_columns,
)
from phaselead.model.operator import address, doubles

SIZES = ("growth", "stribeck", "coulomb")


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.model._kernel", "stage_friction")
    size, data = ctypes.c_size_t, ctypes.c_void_p
    kernel.stage_friction.argtypes = [size, data, ctypes.c_double, size, data, data]
    kernel.stage_friction.restype = None
    return kernel


def friction(q: ArrayLike, levels: ArrayLike, reach: float) -> Samples:
    """Friction (n, m) along the path ``q`` (n,), from 0: Dahl's law with levels (n, m) that change from row to row.

    It comes to its level over a path of ``reach``, in the direction of travel, and stays where the path stands still.
    Raises ValueError when shapes differ.
    """
    q, levels = doubles(q), doubles(levels)
    if levels.ndim != 2 or len(levels) != len(q):
        raise ValueError(f"a path of {len(q)} rows needs levels of as many, not {levels.shape}")
    y = np.empty_like(levels)
    _kernel().stage_friction(len(q), address(q), reach, levels.shape[1], address(levels), address(y))
    return y


def apply(signal: Signal, params: Params) -> Samples:
    return with_columns(signal, basis(signal, params), params, *SIZES)


def basis(signal: Signal, params: Params) -> Samples:
    if not _has_loop(signal):
        return columns(*np.zeros((len(SIZES), len(signal.value))))
    q = signal.value / signal.range_um
    rate = np.abs(np.diff(q, prepend=q[0])) / signal.step_s
    share = rate / number(params, "onset_per_s")
    levels = columns(np.log1p(share) / np.log(10), np.expm1(-share), np.ones_like(share))
    return -signal.range_um / 2 * friction(q, levels, number(params, "reach"))


def _has_loop(signal: Signal) -> bool:
    """Whether there is hysteresis that could change with the rate: without it a loop is hysteresis first."""
    view = signal.axis.time
    return bool(view is not None and view.play_r_V) or any(e.plays is not None for e, _ in signal.active)


def untestable(signal: Signal) -> str | None:
    return None if _has_loop(signal) else "the model has no hysteresis whose width could change"


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    growth, stribeck, coulomb = (given.one(name) for name in SIZES)
    axis.friction((growth, stribeck, coulomb), given.one("onset_per_s", above=0.0), given.one("reach", above=0.0))


EFFECT = Effect(
    name="rate_dependence",
    listed=30,
    title="Rate dependence",
    place=Place.HYSTERESIS,
    order=3,
    equation="y = x - X/2 f,  df/ds = (sign(dq/dt) g - f) / reach along the path s of q = x/X,  "
    "g = coulomb - stribeck (1 - exp(-p)) + growth log10(1 + p),  p = abs(dq/dt) / onset_per_s",
    source="Dahl 1976 (friction that comes to its level along the path); Canudas de Wit, Olsson, Astrom and Lischinsky "
    "1995 (a level that depends on the speed; Stribeck's fall, here Tustin's exponential). The growth is that of the "
    "rate-dependent Prandtl-Ishlinskii model, thresholds alpha ln(beta + lambda abs(dv/dt)) (Al Janaideh, Rakheja and "
    "Su 2009); what narrows a loop with the rate is Stribeck's fall, or creep. Over what path the level is reached "
    "does not depend on the level, so that it is linear in its sizes. It acts beside hysteresis only: a loop alone is "
    "called that",
    parameters=(
        Parameter(
            "growth", "of range", 0.02, -0.3, 0.3, known=(0.0, 0.3), doc="opening of the loop added per decade of rate"
        ),
        Parameter(
            "stribeck", "of range", 0.01, 0.0, 0.3, absorbed_by_refit=True, doc="opening lost between rest and sliding"
        ),
        Parameter(
            "coulomb",
            "of range",
            0.01,
            0.0,
            0.3,
            absorbed_by_refit=True,
            by_itself="hysteresis",
            doc="opening that is the same at every rate: by itself it is hysteresis",
        ),
        Parameter(
            "onset_per_s", "1/s", 1.0, 0.02, 100.0, role="shape", log=True, doc="ranges per second where it sets in"
        ),
        Parameter(
            "reach", "of range", 0.03, 0.002, 0.3, role="shape", log=True, doc="path after which friction has turned"
        ),
    ),
    shows="the loop widens with the logarithm of frequency, or narrows from rest to sliding, while the way stays the "
    "same",
    reveals="the same full loop from 0.1 to 50 Hz, well below the first mode",
    confused_with=("hysteresis", "backlash", "creep", "amplifier_lowpass", "delay", "softening"),
    compensation="Not from its parameters: friction depends on the speed of the path, and the inverse operator is made "
    "for one rate. The phase-lead tables, measured at several frequencies, hold it for periodic paths.",
    apply=apply,
    picture=Picture("loops", {"growth": 0.08}, base="plays"),
    basis=basis,
    untestable=untestable,
    virtual=virtual,
)
