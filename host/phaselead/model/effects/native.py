"""What runs row by row, in C (host/phaselead/model/kernel/effects.c). Every function takes and gives (n,) arrays whose
first row is how things stood before; ``behind_modes`` takes several columns of them, too."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phaselead.compiled import kernel_of

Samples = NDArray[np.float64]
_DATA = ctypes.c_void_p
FUNCTIONS = ("lags", "second_order", "second_order_left", "behind_modes", "slew", "scaled_plays")


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.model._kernel", *(f"stage_{name}" for name in FUNCTIONS))
    size, double = ctypes.c_size_t, ctypes.c_double
    kernel.stage_lags.argtypes = [size, _DATA, size, _DATA, _DATA, _DATA]
    kernel.stage_second_order.argtypes = [size, *[_DATA] * 4]
    kernel.stage_second_order_left.argtypes = [size, *[_DATA] * 4, double, size, *[_DATA] * 2]
    kernel.stage_behind_modes.argtypes = [size, size, _DATA, size, *[_DATA] * 3]
    kernel.stage_slew.argtypes = [size, _DATA, double, _DATA]
    kernel.stage_scaled_plays.argtypes = [size, _DATA, _DATA, size, *[_DATA] * 2, double, *[_DATA] * 2]
    for name in FUNCTIONS:
        getattr(kernel, f"stage_{name}").restype = None
    return kernel


def _doubles(values: ArrayLike) -> Samples:
    return np.ascontiguousarray(values, dtype=np.float64)


def _at(values: Samples) -> int:
    return values.ctypes.data


def lags(x: ArrayLike, tau_s: Sequence[float] | Samples, gain: Sequence[float] | Samples, step_s: float) -> Samples:
    """sum_j gain_j / (tau_j s + 1) of ``x``, settled at x[0]; tau 0 passes it on."""
    x, coefficients = _doubles(x), _lag_coefficients(_doubles(tau_s), _doubles(gain), step_s)
    states, y = np.empty(len(coefficients)), np.empty_like(x)
    _kernel().stage_lags(len(x), _at(x), len(states), _at(coefficients), _at(states), _at(y))
    return y


def _lag_coefficients(tau_s: Samples, gain: Samples, step_s: float) -> Samples:
    """(m, 3): old, new, gain of the ramp-invariant lag."""
    rows = [
        (*_lag(step_s / float(tau)), g) if tau * 1e9 > step_s else (0.0, 1.0, g)
        for tau, g in zip(tau_s, gain, strict=True)
    ]
    return _doubles(rows).reshape(-1, 3)


def _lag(ratio: float) -> tuple[float, float]:
    """Weights of the last and the new input, for ratio = step/tau."""
    if ratio < 1e-4:  # the differences below would cancel
        return ratio / 2 - ratio**2 / 3, ratio / 2 - ratio**2 / 6
    mean = -math.expm1(-ratio) / ratio
    return mean - math.exp(-ratio), 1 - mean


def second_order(x: ArrayLike, b: ArrayLike, a: ArrayLike) -> Samples:
    """sum_i b_i z^-i / sum_i a_i z^-i of ``x``, three each and a_0 = 1; settled at x[0] for a gain of 1 at 0 Hz."""
    x, b, a = _doubles(x), _doubles(b), _doubles(a)
    if b.shape != (3,) or a.shape != (3,):
        raise ValueError(f"a second-order system has three coefficients each, not {b.shape} and {a.shape}")
    y = np.empty_like(x)
    _kernel().stage_second_order(len(x), _at(x), _at(b), _at(a), _at(y))
    return y


def behind_modes(x: ArrayLike, modes: Samples) -> Samples:
    """``x`` (n,) or columns (n, k), of which ``modes`` (m, 7) carry a share each: share, b and a (``second_order``)."""
    x, modes = _doubles(x), _doubles(modes)
    if modes.ndim != 2 or modes.shape[1] != 7:
        raise ValueError(f"modes are (m, 7), got {modes.shape}")
    k = x.size // max(len(x), 1)
    states, y = np.empty(2 * len(modes) * k), np.empty_like(x)
    _kernel().stage_behind_modes(len(x), k, _at(x), len(modes), _at(modes), _at(states), _at(y))
    return y


def second_order_left(
    x: Samples, measured: Samples, system: tuple[Samples, Samples], step_s: float, rows: NDArray[np.uintp]
) -> tuple[float, float, float]:
    """What ``second_order`` of ``x`` with ``system`` (b, a) leaves of ``measured`` at the ascending ``rows``.

    Mean squares of that and of its change with a later answer (per s), and between them their mean product, all about
    the means.
    """
    x, measured, (b, a) = _doubles(x), _doubles(measured), map(_doubles, system)
    rows, means = np.ascontiguousarray(rows, dtype=np.uintp), np.empty(3)
    _kernel().stage_second_order_left(
        len(x), x.ctypes.data, measured.ctypes.data, b.ctypes.data, a.ctypes.data, step_s,
        len(rows), rows.ctypes.data, means.ctypes.data,
    )  # fmt: skip
    left, across, late = means.tolist()
    return left, across, late


def slewed(x: ArrayLike, rise: float) -> Samples:
    """``x`` with a rate of at most ``rise`` per row."""
    x = _doubles(x)
    y = np.empty_like(x)
    _kernel().stage_slew(len(x), _at(x), rise, _at(y))
    return y


def scaled_plays(
    v: ArrayLike, scale: ArrayLike, r: ArrayLike, w: ArrayLike, start: ArrayLike, held: float = 1.0
) -> Samples:
    """sum_j w_j play_j[v], thresholds ``scale`` (n,) times ``r`` (m,), from ``start`` (m,).

    Where a threshold shrinks, what is held back beyond it is let go at once but for the share ``held``, which is let go
    only as the voltage moves, by as much.
    """
    v, scale, r, w = _doubles(v), _doubles(scale), _doubles(r), _doubles(w)
    p, y = np.array(start, dtype=np.float64), np.empty_like(v)
    if not r.shape == w.shape == p.shape or scale.shape != v.shape:
        raise ValueError(f"shapes differ: r {r.shape}, w {w.shape}, start {p.shape}; v {v.shape}, scale {scale.shape}")
    _kernel().stage_scaled_plays(len(v), _at(v), _at(scale), len(r), _at(r), _at(w), held, _at(p), _at(y))
    return y
