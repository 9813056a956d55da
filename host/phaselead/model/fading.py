"""Fading plays: plays that have forgotten where they turned once they have gone on for a while (friction of Dahl).

    dz/d|v| = (sign(dv) - z) / (2 r),    fading play = v - r z

Of threshold r in V; z is between -1 and 1. Plays of the same lag keep every turn that no larger one has wiped out.
"""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from phaselead.compiled import kernel_of
from phaselead.model.operator import address, doubles
from phaselead.record import Samples

ALIKE = 4
"""Plays that stand for a fading one."""
REACHED = 64
"""Plays by which the state of a fading one is told: to a hundredth."""
REVERSIBLE = 0.5
"""Share of a fading play that stands for it without memory: in a small steady loop it follows by so much."""


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.model._kernel", "stage_fading_plays")
    size, array = ctypes.c_size_t, ctypes.c_void_p
    kernel.stage_fading_plays.argtypes = [size, array, size, array, array, array, array]
    kernel.stage_fading_plays.restype = None
    return kernel


def fading_lag_um(v: ArrayLike, r: ArrayLike, w: ArrayLike, start: ArrayLike) -> Samples:
    """sum_j w_j (fading play_rj[v] - v), (n,) in um, for ``v`` (n,) and ``r`` (m,) in V and ``w`` (m,) in um/V, from
    the states z ``start`` (m,). Raises ValueError when shapes differ."""
    v, r, w, z = doubles(v), doubles(r), doubles(w), np.array(start, dtype=np.float64)
    if not r.shape == w.shape == z.shape:
        raise ValueError(f"shapes differ: r {r.shape}, w {w.shape}, start {z.shape}")
    y = np.empty_like(v)
    _kernel().stage_fading_plays(len(v), address(v), len(r), address(r), address(w), address(z), address(y))
    return y


def state_after(v: ArrayLike, r: Samples, start: Samples) -> Samples:
    """z (m,) of fading plays of thresholds ``r`` (m,) that have gone through the voltages ``v`` (n,) one after the
    other, from ``start`` (m,)."""
    z, path = np.array(start, dtype=np.float64), np.asarray(v, dtype=np.float64)
    for way in np.diff(path):
        z = np.sign(way) + (z - np.sign(way)) * np.exp(-abs(way) / (2 * r)) if way else z
    return np.asarray(z)


def opening_V(r: ArrayLike, span_V: float) -> Samples:
    """By how much fading plays of thresholds ``r`` (m,) in V open at the middle of a steady loop over ``span_V``."""
    r = np.asarray(r, dtype=np.float64)
    return np.asarray(2 * r * (1 - 1 / np.cosh(np.minimum(span_V / (4 * r), 700.0))))


def plays_alike(r_V: float) -> Samples:
    """Thresholds (ALIKE,) in V of plays that have the steady loops of a fading one of threshold ``r_V``: so much of
    them as is not ``REVERSIBLE``, in equal parts.

    Over a span A it moves by A - 2 r tanh(A / 4r), of which the slope is 1 - sech^2(A / 4r) / 2: a half, and plays of
    which the share tanh^2(A / 4r) has a threshold below A / 2.
    """
    return np.asarray(2 * r_V * np.arctanh(np.sqrt((np.arange(ALIKE) + 0.5) / ALIKE)))


def _reached_V(r_V: float) -> Samples:
    """Thresholds (REACHED,) in V of plays that together leave a settled turn as a fading one does: the share of them
    that moves again after a way p is 1 - exp(-p / 2r)."""
    return np.asarray(-r_V * np.log(1 - (np.arange(REACHED) + 0.5) / REACHED))


def state_like_plays(r_V: float, play_r_V: ArrayLike, lag_V: ArrayLike) -> float:
    """z of a fading play of threshold ``r_V`` where the stage has come the way of these plays (m,), which lag by
    ``lag_V`` (m,): v less each. 0 without plays."""
    known = np.asarray(play_r_V, dtype=np.float64)
    if not len(known):
        return 0.0
    like = _reached_V(r_V)
    lag = np.interp(like, np.concatenate([[0.0], known]), np.concatenate([[0.0], np.asarray(lag_V, dtype=np.float64)]))
    return float(np.clip(np.mean(np.clip(lag, -like, like)) / np.mean(like), -1.0, 1.0))
