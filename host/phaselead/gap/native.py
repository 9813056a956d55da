"""Whitening in C (host/phaselead/gap/kernel): what runs over every row of every column."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np
from numpy.typing import NDArray

from phaselead.compiled import kernel_of
from phaselead.record import Samples

_SIZE, _DATA = ctypes.c_size_t, ctypes.c_void_p


class _Whitener(ctypes.Structure):
    """struct gap_whitener."""

    _fields_ = (
        ("n_sensor", _SIZE), ("sensor", _DATA), ("phi", _DATA), ("diag", _DATA), ("below", _DATA),
        ("n_rest", _SIZE), ("rest", _DATA), ("moving", _DATA),
    )  # fmt: skip


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.gap._kernel", "gap_differences_factor")
    kernel.gap_whiten.argtypes = [ctypes.POINTER(_Whitener), _SIZE, _SIZE, _DATA, _DATA, _DATA]
    kernel.gap_differences_factor.argtypes = [_SIZE, _DATA, _DATA, ctypes.c_double, _DATA, _DATA]
    kernel.gap_whiten.restype = kernel.gap_differences_factor.restype = None
    return kernel


def differences_factor(phi: Samples, grown: Samples, first: float) -> Samples:
    """Lower Cholesky factor, banded (2, n), of the covariance of n_k - phi_k n_{k-1} + w_k for unit white n and w of
    the variance ``grown`` (n,); the first row's is 1 + ``first``."""
    phi, grown = (np.ascontiguousarray(a, dtype=np.float64) for a in (phi, grown))
    factor = np.empty((2, len(phi)))
    diag, below = factor
    _kernel().gap_differences_factor(
        len(phi), phi.ctypes.data, grown.ctypes.data, first, diag.ctypes.data, below.ctypes.data
    )
    return factor


def whitened(
    values: Samples, sensor: Samples, phi: Samples, factor: Samples, rest: Samples, moving: NDArray[np.bool_]
) -> Samples:
    """``values`` (n, ...) filtered by ``sensor``, freed of what lasts along the path by ``phi`` (n,) and the banded
    Cholesky ``factor`` (2, n), and in ``moving`` rows filtered by ``rest``."""
    rows = np.ascontiguousarray(values, dtype=np.float64).reshape(len(values), -1)
    steps, white = np.empty_like(rows), np.empty_like(rows)
    kept = [np.ascontiguousarray(a, dtype=np.float64) for a in (sensor, phi, factor[0], factor[1], rest)]
    moves = np.ascontiguousarray(moving, dtype=np.uint8)
    taps, along, diag, below, last = (a.ctypes.data for a in kept)
    by = _Whitener(len(kept[0]), taps, along, diag, below, len(kept[4]), last, moves.ctypes.data)
    _kernel().gap_whiten(by, *rows.shape, rows.ctypes.data, steps.ctypes.data, white.ctypes.data)
    return white.reshape(np.shape(values))
