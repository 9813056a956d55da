"""The time-domain view of a stage: plays, one-sided dead zones, an offset and a delay.

    x(t) = offset + gain v + sum_i w_i play_{r_i}[v] + sum_j s_j max(v - d_j, 0),   v(t) = u(t - delay)

(Kuhnen 2003, eqs. 5, 8 and 30). Units: V, um, s. "Rest" is 0 V with the plays at ``rest_fraction * r``; the
sensor reads ``rest_position_um`` there.

Between rows the voltage runs straight, and before the first row it was 0 V, at rest: a record that begins at
1.8 V began with a step. Only a record that continues another (``initial_plays_V`` given) was at its first
voltage before.
"""

from __future__ import annotations

import ctypes
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phaselead.compiled import kernel_of
from phaselead.model.axis import TimeView

Samples = NDArray[np.float64]


class _Operator(ctypes.Structure):
    _fields_ = (
        ("gain", ctypes.c_double),
        ("n_plays", ctypes.c_size_t),
        ("play_r", ctypes.c_void_p),
        ("play_w", ctypes.c_void_p),
        ("n_deadzones", ctypes.c_size_t),
        ("deadzone_d", ctypes.c_void_p),
        ("deadzone_s", ctypes.c_void_p),
    )


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.model._kernel")
    size, double = ctypes.c_size_t, ctypes.c_double
    array = ctypes.c_void_p
    kernel.stage_delay.argtypes = [size, array, double, double, array]
    kernel.stage_plays.argtypes = [size, array, size, array, array, size, array, array]
    kernel.stage_response.argtypes = [ctypes.POINTER(_Operator), size, array, array, array]
    for function in (kernel.stage_delay, kernel.stage_plays, kernel.stage_response):
        function.restype = None
    return kernel


def _doubles(values: ArrayLike) -> Samples:
    return np.ascontiguousarray(values, dtype=np.float64)


def _at(values: NDArray[np.generic]) -> int:
    return values.ctypes.data


def delayed(u: ArrayLike, samples: float, before: float = 0.0) -> Samples:
    """``u`` (n,) late by ``samples`` >= 0, a real number; ahead of the first row it stood at ``before``."""
    u = _doubles(u)
    if not samples >= 0:
        raise ValueError(f"a delay of {samples} samples would need the future")
    v = np.empty_like(u)
    _kernel().stage_delay(len(u), _at(u), before, samples, _at(v))
    return v


def plays(
    v: ArrayLike, r: ArrayLike, start: ArrayLike, rows: NDArray[np.uintp] | None = None
) -> tuple[Samples, Samples]:
    """Run plays of thresholds ``r`` (m,) over ``v`` (n,) from ``start`` (m,).

    Returns their positions at the ascending ``rows`` (all by default), (len(rows), m), and after the last
    sample, (m,).
    """
    v, r, end = _doubles(v), _doubles(r), np.array(start, dtype=np.float64)
    if end.shape != r.shape:
        raise ValueError(f"{len(r)} plays need as many starting positions, got {end.shape}")
    rows = np.arange(len(v), dtype=np.uintp) if rows is None else np.ascontiguousarray(rows, dtype=np.uintp)
    out = np.empty((len(rows), len(r)))
    _kernel().stage_plays(len(v), _at(v), len(r), _at(r), _at(end), len(rows), _at(rows), _at(out))
    return out, end


def rest_plays(view: TimeView) -> Samples:
    """Positions of the plays (m,) in V, at rest at 0 V."""
    return view.rest_fraction * _doubles(view.play_r_V)


def respond(view: TimeView, v: ArrayLike, start: ArrayLike) -> tuple[Samples, Samples]:
    """Position (n,) in um for a voltage ``v`` already delayed, from plays ``start``; and where they end."""
    v, end = _doubles(v), np.array(start, dtype=np.float64)
    r, w = _doubles(view.play_r_V), _doubles(view.play_w_um_per_V)
    d, s = _doubles(view.deadzone_d_V), _doubles(view.deadzone_s_um_per_V)
    if not r.shape == w.shape == end.shape or d.shape != s.shape:
        raise ValueError("plays and dead zones need one threshold, one weight and one start each")
    x = np.empty_like(v)
    operator = _Operator(view.gain_um_per_V, len(r), _at(r), _at(w), len(d), _at(d), _at(s))
    _kernel().stage_response(ctypes.byref(operator), len(v), _at(v), _at(end), _at(x))
    return x + view.offset_um, end


@lru_cache(maxsize=64)
def rest_position_um(view: TimeView) -> float:
    """What the sensor reads at rest at 0 V."""
    return float(respond(view, [0.0], rest_plays(view))[0][0])


def predict_time_view(
    view: TimeView, t_s: Samples, u_V: Samples, *, initial_plays_V: ArrayLike | None = None
) -> Samples:
    """Position (n,) in um for the applied voltage ``u_V`` (n,) at the uniform times ``t_s`` (n,).

    From rest at 0 V, or from ``initial_plays_V`` (one per play) as a continuation that stood at ``u_V[0]``.
    """
    u = _doubles(u_V)
    step = (t_s[-1] - t_s[0]) / (len(t_s) - 1) if len(t_s) > 1 else 1.0
    before = 0.0 if initial_plays_V is None else float(u[0])
    start = rest_plays(view) if initial_plays_V is None else initial_plays_V
    return respond(view, delayed(u, view.delay_s / step, before), start)[0]
