"""A loop that widens with the rate of the voltage."""

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
    number,
)
from phaselead.model.operator import address, doubles, weighed_plays


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.model._kernel", "stage_scaled_plays")
    size, double, data = ctypes.c_size_t, ctypes.c_double, ctypes.c_void_p
    kernel.stage_scaled_plays.argtypes = [size, data, data, size, data, data, double, data, data]
    kernel.stage_scaled_plays.restype = None
    return kernel


def scaled_plays(
    v: ArrayLike, scale: ArrayLike, r: ArrayLike, w: ArrayLike, start: ArrayLike, held: float = 1.0
) -> Samples:
    """sum_j w_j play_j[v] (n,), thresholds ``scale`` (n,) times ``r`` (m,), from ``start`` (m,).

    Where a threshold shrinks, what is held back beyond it is let go at once but for the share ``held``, which is let go
    only as the voltage moves, by as much. Raises ValueError when shapes differ.
    """
    v, scale, r, w = doubles(v), doubles(scale), doubles(r), doubles(w)
    p, y = np.array(start, dtype=np.float64), np.empty_like(v)
    if not r.shape == w.shape == p.shape or scale.shape != v.shape:
        raise ValueError(f"shapes differ: r {r.shape}, w {w.shape}, start {p.shape}; v {v.shape}, scale {scale.shape}")
    arrays = (address(r), address(w), held, address(p), address(y))
    _kernel().stage_scaled_plays(len(v), address(v), address(scale), len(r), *arrays)
    return y


def apply(signal: Signal, params: Params) -> Samples:
    if number(params, "widening") == 0:
        return signal.value
    r, w, start = _plays(signal)
    if not len(r):
        return signal.value
    v, spread = signal.driven_V, number(params, "spread")
    r, w, start = spread * r, w / spread, v[0] + spread * (start - v[0])
    widened = scaled_plays(v, scale(signal, params), r, w, start, number(params, "held"))
    return signal.value + widened - weighed_plays(v, r, w, start)


def scale(signal: Signal, params: Params) -> Samples:
    """(n,) factor on every threshold."""
    low, high = signal.span_V
    rate = np.abs(np.diff(signal.driven_V, prepend=signal.driven_V[0])) / (signal.step_s * (high - low))
    return 1 + number(params, "widening") * np.log10(1 + rate / number(params, "onset_per_s"))


def _plays(signal: Signal) -> tuple[Samples, Samples, Samples]:
    """Thresholds, weights and start of the plays of the base and of adopted effects."""
    view = signal.axis.time
    r = [np.asarray(view.play_r_V if view else ())]
    w = [np.asarray(view.play_w_um_per_V if view else ())]
    start = [signal.start_plays_V]
    for effect, params in signal.active:
        if effect.plays is not None:
            more_r, more_w, more_start = effect.plays(signal, params)
            r, w, start = [*r, more_r], [*w, more_w], [*start, more_start]
    return np.concatenate(r), np.concatenate(w), np.concatenate(start)


def untestable(signal: Signal) -> str | None:
    return None if len(_plays(signal)[0]) else "the model has no hysteresis whose width could change"


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    widening, held = given.one("widening", low=0.0), given.one("held", low=0.0)
    onset_V_per_s = given.one("onset_per_s", above=0.0) * axis.range_V
    axis.widening(widening, onset_V_per_s, held, given.one("spread", above=0.0) if widening else 0.0)


EFFECT = Effect(
    name="rate_dependence",
    listed=30,
    title="Rate dependence",
    place=Place.HYSTERESIS,
    order=2,
    equation="y = x + sum_i (w_i / spread) (play_ri(t)[v] - play_ri[v]),  r_i = spread times the loop's own,  "
    "r_i(t) = r_i (1 + widening log10(1 + abs(dv/dt) / (U onset_per_s))); of what is held back beyond "
    "a threshold that shrinks the share `held` is let go only as the voltage moves on, the rest at once",
    source="Ang, Khosla and Riviere 2007 (rate-dependent Prandtl-Ishlinskii); Al Janaideh, Rakheja and Su 2009 "
    "(thresholds alpha ln(beta + lambda abs(dv/dt)))",
    parameters=(
        Parameter("widening", "per decade", 0.2, 0.0, 1.5, doc="growth of every threshold per decade of rate"),
        Parameter(
            "onset_per_s", "1/s", 1.0, 0.02, 100.0, role="shape", log=True, doc="ranges per second where it sets in"
        ),
        Parameter(
            "spread",
            "1",
            1.0,
            0.15,
            1.0,
            role="shape",
            log=True,
            absorbed_by_refit=True,
            doc="thresholds of what widens, as a share of the loop's own",
        ),
        Parameter("held", "1", 1.0, 0.0, 1.0, role="shape", doc="share let go only as the voltage moves on"),
    ),
    shows="loop width against the logarithm of frequency is a straight line, while the way stays the same",
    reveals="the same full loop from 0.1 to 50 Hz, well below the first mode",
    confused_with=("hysteresis", "backlash", "creep", "amplifier_lowpass", "delay", "softening"),
    compensation="Not from its parameters: the inverse operator is made for one rate. The phase-lead tables, measured "
    "at several frequencies, hold it for periodic paths.",
    apply=apply,
    picture=Picture("loops", {"widening": 0.6}, base="plays"),
    untestable=untestable,
    virtual=virtual,
)
