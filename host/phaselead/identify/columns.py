"""The columns of the operator fit, in C (host/phaselead/model/operator.c): a fit asks for thousands of them."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from phaselead.compiled import kernel_of
from phaselead.record import Samples

_SIZE, _DOUBLE, _ARRAY = ctypes.c_size_t, ctypes.c_double, ctypes.c_void_p


class _Record(ctypes.Structure):
    _fields_ = (
        ("n", _SIZE),
        ("u", _ARRAY),
        ("before", _DOUBLE),
        ("n_turns", _SIZE),
        ("turns", _ARRAY),
        ("n_rows", _SIZE),
        ("rows", _ARRAY),
        ("x", _ARRAY),
    )


class _Basis(ctypes.Structure):
    _fields_ = (
        ("n_segments", _SIZE),
        ("low", _ARRAY),
        ("high", _ARRAY),
        ("segment_rest", _ARRAY),
        ("n_plays", _SIZE),
        ("r", _ARRAY),
        ("play_rest", _ARRAY),
    )


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.model._kernel", "stage_columns")
    kernel.stage_columns.argtypes = [ctypes.POINTER(_Record), _DOUBLE, ctypes.POINTER(_Basis), _ARRAY, _ARRAY]
    kernel.stage_columns.restype = None
    return kernel


def _doubles(values: Samples) -> Samples:
    return np.ascontiguousarray(values, dtype=np.float64)


class Columns:
    """One record: its voltage (n,), the ascending rows that count, the positions there; ``before_V``: ahead of row 0.

    ``turns`` are those of ``AxisRun.turning_rows``.
    """

    def __init__(
        self, u_V: Samples, before_V: float, turns: NDArray[np.uintp], rows: NDArray[np.uintp], x_um: Samples
    ) -> None:
        # The kernel keeps addresses: what they point to must live as long.
        self._arrays = u, turns, rows, x = _doubles(u_V), turns, np.ascontiguousarray(rows, np.uintp), _doubles(x_um)
        self._record = _Record(len(u), *(u.ctypes.data, before_V, len(turns), turns.ctypes.data),
                               *(len(rows), rows.ctypes.data, x.ctypes.data))  # fmt: skip
        self._address = ctypes.byref(self._record)

    def fill(self, out: Samples, delay_rows: float, slopes: Slopes, start: Samples) -> None:
        """Into ``out`` (rows, segments + plays + 2): what a unit slope of each adds to the position, 1, the position.

        ``start`` (plays,) in V is where the plays begin.
        """
        if not delay_rows >= 0:
            raise ValueError(f"a delay of {delay_rows} rows would need the future")
        end = np.array(start, dtype=np.float64)
        _kernel().stage_columns(self._address, delay_rows, slopes.address, end.ctypes.data, out.ctypes.data)


class Slopes:
    """Segments (ends, where 0 V stands in each; all (s,)) and plays (thresholds, where each rests; (m,)), in V."""

    def __init__(self, segments: Sequence[Samples], play_r_V: Samples, play_rest_V: Samples) -> None:
        low, high, at_rest = map(_doubles, segments)
        r, rest = _doubles(play_r_V), _doubles(play_rest_V)
        self._arrays = low, high, at_rest, r, rest
        self._basis = _Basis(
            len(low), *(a.ctypes.data for a in (low, high, at_rest)), len(r), r.ctypes.data, rest.ctypes.data
        )
        self.address = ctypes.byref(self._basis)
