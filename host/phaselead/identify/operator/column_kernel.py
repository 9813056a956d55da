"""The columns of a fit as the kernels make them (host/phaselead/model: operator.c, columns_behind_modes.c): a fit asks
for thousands of them."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phaselead.compiled import kernel_of
from phaselead.model import DensityInC, PlayDensity
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
        ("density", DensityInC),
        ("n_fading", _SIZE),
        ("fading_r", _ARRAY),
        ("fading_rest", _ARRAY),
    )


@cache
def _kernel() -> ctypes.CDLL:
    functions = ("stage_columns", "stage_columns_behind_modes", "stage_room_behind_modes")
    kernel = kernel_of("phaselead.model._kernel", *functions, sizes={"stage_basis_size": _Basis})
    record, basis = ctypes.POINTER(_Record), ctypes.POINTER(_Basis)
    kernel.stage_columns.argtypes = [record, _DOUBLE, basis, *[_ARRAY] * 3]
    kernel.stage_columns.restype = None
    kernel.stage_columns_behind_modes.argtypes = [record, _DOUBLE, basis, _SIZE, *[_ARRAY] * 4]
    kernel.stage_columns_behind_modes.restype = None
    kernel.stage_room_behind_modes.argtypes = [record, basis, _SIZE]
    kernel.stage_room_behind_modes.restype = _SIZE
    return kernel


def _doubles(values: Samples) -> Samples:
    return np.ascontiguousarray(values, dtype=np.float64)


class Start(NamedTuple):
    """Where the memory of a record begins."""

    plays_V: Samples
    """(m,)"""
    fading: Samples
    """(k,) states of the fading plays, -1 to 1."""


class RecordInC:
    """One record as the kernel reads it.

    Its voltage (n,), ``before_V`` ahead of row 0, ``AxisRun.turning_rows``, the ascending ``rows`` that count, and the
    positions ``x_um`` (rows,) there.
    """

    def __init__(
        self, u_V: Samples, before_V: float, turns: NDArray[np.uintp], rows: NDArray[np.uintp], x_um: Samples
    ) -> None:
        # The kernel keeps addresses: what they point to must live as long.
        self._arrays = u, turns, rows, x = _doubles(u_V), turns, np.ascontiguousarray(rows, np.uintp), _doubles(x_um)
        self._record = _Record(len(u), *(u.ctypes.data, before_V, len(turns), turns.ctypes.data),
                               *(len(rows), rows.ctypes.data, x.ctypes.data))  # fmt: skip
        self._address = ctypes.byref(self._record)

    def with_voltage(self, u_V: Samples, turns: NDArray[np.uintp]) -> RecordInC:
        """The same rows and positions after another voltage (n,) and its turning rows."""
        _, _, rows, x_um = self._arrays
        return RecordInC(u_V, self._record.before, turns, rows, x_um)

    def fill(
        self, out: Samples, delay_rows: float, basis: BasisInC, start: Start, modes: Samples | None = None
    ) -> None:
        """Write the columns [segments, plays, fading plays, 1, position] into ``out`` (rows, columns), in V and um.

        ``modes`` (m, 7), ``modes_in_C``: the columns are then what these make of the motion. Raises ValueError for a
        negative delay, and for modes with a basis that does not go or stand.
        """
        if not delay_rows >= 0:
            raise ValueError(f"a delay of {delay_rows} rows would need the future")
        if modes is not None and not basis.goes_or_stands:
            raise ValueError("behind modes the kernel makes columns of plays that are even and do not fade, no others")
        plays_V, fading = (np.array(one, dtype=np.float64) for one in start)
        if modes is None:
            data = (one.ctypes.data for one in (plays_V, fading, out))
            _kernel().stage_columns(self._address, delay_rows, basis.address, *data)
            return
        room = np.empty(_kernel().stage_room_behind_modes(self._address, basis.address, len(modes)))
        data = (one.ctypes.data for one in (modes, plays_V, room, out))
        _kernel().stage_columns_behind_modes(self._address, delay_rows, basis.address, len(modes), *data)


class BasisInC:
    """A basis as the kernel reads it, all in V: ends of the segments and where 0 V stands in each, three of (s,);
    thresholds of the plays and what each of that density adds at rest, (m,); thresholds of the fading plays and where
    each stands at rest, (k,)."""

    def __init__(
        self,
        segments: Sequence[Samples],
        plays_V: tuple[Samples, Samples],
        density: PlayDensity,
        fading_V: tuple[Samples, Samples],
    ) -> None:
        low, high, at_rest = map(_doubles, segments)
        (r, rest), (fading_r, fading_rest) = map(_doubles, plays_V), map(_doubles, fading_V)
        self._arrays = low, high, at_rest, r, rest, fading_r, fading_rest
        self._basis = _Basis(
            *(len(low), low.ctypes.data, high.ctypes.data, at_rest.ctypes.data),
            *(len(r), r.ctypes.data, rest.ctypes.data, DensityInC.of(density)),
            *(len(fading_r), fading_r.ctypes.data, fading_rest.ctypes.data),
        )
        self.address = ctypes.byref(self._basis)
        self.goes_or_stands = density.is_even and not len(fading_r)
        """Whether each column either goes with the voltage or stands still."""
