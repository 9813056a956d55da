"""The time-domain view of a stage: plays, one-sided dead zones, an offset and a delay.

    x(t) = offset + gain v + sum_i w_i read(play_{r_i}[v]) + sum_j s_j max(v - d_j, 0),   v(t) = field(u(t - delay))

(Kuhnen 2003, eqs. 5, 8 and 30; the field, ``field.EffectiveField``, is the voltage itself unless it bends; what is read
of a play, ``play_density.PlayDensity``, is where it stands unless its weight depends on the level). Units: V,
um, s. "Rest" is 0 V with the plays at ``rest_fraction * r``; the sensor reads ``rest_position_um`` there.

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
from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.play_density import PlayDensity
from phaselead.record import Samples

CURVE_PIECES = 16
"""Straight pieces that a parabola over the range is drawn with in a time view: within 0.4 % of its size. All have the
same ends, so that several need no more dead zones than one."""
NO_WEIGHT = 1e-6
"""Plays and bends below this share of the mean slope add nothing, and are left out of a time view."""
LEG_ROWS = 60
"""Of each way between two turns of the loops along which even plays are fitted to others."""


class DensityInC(ctypes.Structure):
    """struct stage_density of operator.h."""

    _fields_ = tuple((name, ctypes.c_double) for name in ("tilt", "taper", "middle", "half", "at_zero"))

    @staticmethod
    def of(density: PlayDensity) -> DensityInC:
        """As the kernel reads it."""
        low, high = density.span_V
        middle = (low + high) / 2
        return DensityInC(density.tilt, density.taper, middle, (high - low) / 2, -float(density.read(middle)))


class _Operator(ctypes.Structure):
    _fields_ = (
        ("gain", ctypes.c_double),
        ("n_plays", ctypes.c_size_t),
        ("play_r", ctypes.c_void_p),
        ("play_w", ctypes.c_void_p),
        ("density", DensityInC),
        ("n_deadzones", ctypes.c_size_t),
        ("deadzone_d", ctypes.c_void_p),
        ("deadzone_s", ctypes.c_void_p),
    )


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.model._kernel", sizes={"stage_operator_size": _Operator})
    size, double = ctypes.c_size_t, ctypes.c_double
    array = ctypes.c_void_p
    kernel.stage_delay.argtypes = [size, array, double, double, array]
    kernel.stage_plays.argtypes = [size, array, size, array, array, size, array, array]
    kernel.stage_weighed_plays.argtypes = [size, array, double, size, array, array, array, array]
    kernel.stage_response.argtypes = [ctypes.POINTER(_Operator), size, array, array, array]
    for function in (kernel.stage_delay, kernel.stage_plays, kernel.stage_weighed_plays, kernel.stage_response):
        function.restype = None
    return kernel


def doubles(values: ArrayLike) -> Samples:
    """``values`` as the compiled functions take them."""
    return np.ascontiguousarray(values, dtype=np.float64)


def address(values: NDArray[np.generic]) -> int:
    """Where an array begins in memory, for a compiled function; the caller keeps the array alive."""
    return values.ctypes.data


def delayed(u: ArrayLike, samples: float, before: float = 0.0) -> Samples:
    """``u`` (n,) late by ``samples`` >= 0, a real number; ahead of the first row it stood at ``before``."""
    u = doubles(u)
    if not samples >= 0:
        raise ValueError(f"a delay of {samples} samples would need the future")
    v = np.empty_like(u)
    _kernel().stage_delay(len(u), address(u), before, samples, address(v))
    return v


def plays(
    v: ArrayLike, r: ArrayLike, start: ArrayLike, rows: NDArray[np.uintp] | None = None
) -> tuple[Samples, Samples]:
    """Run plays of thresholds ``r`` (m,) over ``v`` (n,) from ``start`` (m,).

    Returns their positions at the ascending ``rows`` (all by default), (len(rows), m), and after the last
    sample, (m,).
    """
    v, r, end = doubles(v), doubles(r), np.array(start, dtype=np.float64)
    if end.shape != r.shape:
        raise ValueError(f"{len(r)} plays need as many starting positions, got {end.shape}")
    rows = np.arange(len(v), dtype=np.uintp) if rows is None else np.ascontiguousarray(rows, dtype=np.uintp)
    out = np.empty((len(rows), len(r)))
    _kernel().stage_plays(len(v), address(v), len(r), address(r), address(end), len(rows), address(rows), address(out))
    return out, end


def weighed_plays(v: ArrayLike, r: ArrayLike, w: ArrayLike, start: ArrayLike) -> Samples:
    """sum_j w_j play_rj[v] (n,) for ``v`` (n,), thresholds ``r``, weights ``w`` and positions ``start`` (m,).

    Raises ValueError when their lengths differ.
    """
    v, r, w, p = doubles(v), doubles(r), doubles(w), np.array(start, dtype=np.float64)
    if not r.shape == w.shape == p.shape:
        raise ValueError(f"shapes differ: r {r.shape}, w {w.shape}, start {p.shape}")
    y = np.empty_like(v)
    _kernel().stage_weighed_plays(len(v), address(v), 1.0, len(r), address(r), address(w), address(p), address(y))
    return y


def rest_plays(view: TimeView) -> Samples:
    """Positions of the plays (m,) in V, at rest at 0 V."""
    return view.rest_fraction * doubles(view.play_r_V)


def plays_after(view: TimeView, *turned_V: float, r_V: ArrayLike | None = None) -> Samples:
    """Positions of the plays (m,) in V of a stage that went from rest to each of these voltages in turn.

    ``r_V``: thresholds (m,) of other plays than the model's, which rest alike."""
    r = doubles(view.play_r_V if r_V is None else r_V)
    at_V = view.rest_fraction * r
    for v in map(view.field.at, turned_V):
        at_V = np.clip(at_V, v - r, v + r)
    return at_V


class PreparedOperator:
    """The operator of a time view as the kernel reads it, prepared once for many voltages."""

    def __init__(self, view: TimeView) -> None:
        r, w = doubles(view.play_r_V), doubles(view.play_w_um_per_V)
        d, s = doubles(view.deadzone_d_V), doubles(view.deadzone_s_um_per_V)
        if r.shape != w.shape or d.shape != s.shape:
            raise ValueError("plays and dead zones need one threshold and one weight each")
        self._view = view
        self._arrays = r, w, d, s  # kept alive for the kernel
        self._in_c = _Operator(
            view.gain_um_per_V, len(r), address(r), address(w), DensityInC.of(view.density),
            len(d), address(d), address(s),
        )  # fmt: skip

    def respond(self, v: ArrayLike, start: ArrayLike) -> tuple[Samples, Samples]:
        """Position (n,) in um for a voltage ``v`` already delayed, from plays ``start`` (m,); and where they end.

        Raises ValueError when there are not as many starts as plays.
        """
        v, end = doubles(self._view.field.of(v)), np.array(start, dtype=np.float64)
        if end.shape != self._arrays[0].shape:
            raise ValueError(f"{len(self._arrays[0])} plays need as many starting positions, got {end.shape}")
        x = np.empty_like(v)
        _kernel().stage_response(ctypes.byref(self._in_c), len(v), address(v), address(end), address(x))
        return x + self._view.offset_um, end


def respond(view: TimeView, v: ArrayLike, start: ArrayLike) -> tuple[Samples, Samples]:
    """``PreparedOperator.respond`` of a view, once."""
    return PreparedOperator(view).respond(v, start)


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
    u = doubles(u_V)
    step = (t_s[-1] - t_s[0]) / (len(t_s) - 1) if len(t_s) > 1 else 1.0
    before = 0.0 if initial_plays_V is None else float(u[0])
    start = rest_plays(view) if initial_plays_V is None else initial_plays_V
    return respond(view, delayed(u, view.delay_s / step, before), start)[0]


def range_um(axis: AxisModel) -> float:
    """Quasi-static travel in um over the voltages the time view was fitted on; the sensor's span without a view."""
    low, high = ends_um(axis)
    return abs(high - low) or 1.0


def ends_um(axis: AxisModel) -> tuple[float, float]:
    """Positions in um at the ends of a full, slow loop over the voltages the time view was fitted on."""
    if axis.time is None:
        return axis.sensor.x_min_um, axis.sensor.x_max_um
    return _ends_um(axis.time)


@lru_cache(maxsize=64)
def _ends_um(view: TimeView) -> tuple[float, float]:
    low, high = map(view.field.at, view.u_range_V)
    middle = (low + high) / 2
    at_low = at_high = view.offset_um
    at_low += view.gain_um_per_V * low
    at_high += view.gain_um_per_V * high
    for r, w in zip(view.play_r_V, view.play_w_um_per_V, strict=True):
        at_low += w * float(view.density.read(min(low + r, middle)))
        at_high += w * float(view.density.read(max(high - r, middle)))
    for d, s in zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True):
        at_low += s * max(low - d, 0.0)
        at_high += s * max(high - d, 0.0)
    return at_low, at_high


def resting_at(view: TimeView, rest_um: float) -> TimeView:
    """The view with the offset that makes it rest at ``rest_um``."""
    return view.model_copy(update={"offset_um": view.offset_um + rest_um - rest_position_um(view)})


@lru_cache(maxsize=64)
def with_even_plays(view: TimeView) -> TimeView:
    """The view in an even field whose plays weigh the same at all levels, as the device has no others: plays of the
    same thresholds and straight pieces, by least squares along the way up from rest, a full loop and smaller ones.

    So that it rises wherever a voltage turns round, a piece keeps at least half of the slope that the view has there
    while its plays stand still. Plays too wide to turn in a full loop keep the weight that they have at mid-range.
    """
    if view.is_even:
        return view
    from scipy.optimize import lsq_linear  # at the top it would double the time that this package takes to load

    low, high = view.u_range_V
    knots = np.linspace(low, high, CURVE_PIECES + 1)
    u = _from_rest_and_smaller(low, high)
    inside = (u >= low) & (u <= high)
    r, rest = doubles(view.play_r_V), rest_plays(view)
    moved = plays(u, r, rest)[0] - rest
    turning = 2 * r < high - low
    weights = doubles(view.play_w_um_per_V) * view.density.at(np.full(len(r), sum(view.density.span_V) / 2))
    x = respond(view, u, rest)[0] - rest_position_um(view) - moved[:, ~turning] @ weights[~turning]
    ends = np.concatenate([[-np.inf], knots[1:-1], [np.inf]])
    pieces = np.clip(u[:, None], ends[:-1], ends[1:]) - np.clip(0.0, ends[:-1], ends[1:])
    columns = np.concatenate([pieces, moved[:, turning]], axis=1)
    side = -1.0 if view.gain_um_per_V < 0 else 1.0
    standing = side * np.diff(without_plays_um(view, view.field.of(knots))) / np.diff(knots)
    least = np.concatenate([np.where(standing > 0, standing / 2, -np.inf), np.zeros(int(turning.sum()))])
    found = side * lsq_linear(columns[inside], side * x[inside], (least, np.inf)).x
    slopes, weights[turning] = found[: len(knots) - 1], found[len(knots) - 1 :]
    weights[np.abs(weights) < NO_WEIGHT * abs(slopes).mean()] = 0.0
    update = {
        "gain_um_per_V": float(slopes[0]),
        "play_w_um_per_V": tuple(weights.tolist()),
        "deadzone_d_V": tuple(knots[1:-1].tolist()),
        "deadzone_s_um_per_V": tuple(np.diff(slopes).tolist()),
        "field_bend": 0.0,
        "play_tilt": 0.0,
        "play_taper": 0.0,
    }
    return resting_at(view.model_copy(update=update), rest_position_um(view))


def _from_rest_and_smaller(low_V: float, high_V: float) -> Samples:
    """Voltages (n,) from 0 V to the upper end, of a full loop and of eight smaller ones about the middle."""
    middle_V, half_V = (low_V + high_V) / 2, (high_V - low_V) / 2
    turns_V = middle_V + half_V * np.repeat(np.arange(9, 0, -1) / 9, 2) * np.tile([1.0, -1.0], 9)
    turns_V = np.concatenate([[0.0], turns_V, [middle_V]])
    legs = np.arange((len(turns_V) - 1) * LEG_ROWS + 1) / LEG_ROWS
    return np.asarray(np.interp(legs, np.arange(len(turns_V)), turns_V))


def without_plays_um(view: TimeView, v: Samples) -> Samples:
    """(n,) at a field of (n,) V, without the offset."""
    bends = zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True)
    return np.asarray(view.gain_um_per_V * v + sum(s * np.maximum(v - d, 0.0) for d, s in bends))


def turned_view(view: TimeView) -> TimeView:
    """The view of a sensor that counts the other way."""
    update = {
        "gain_um_per_V": -view.gain_um_per_V,
        "play_w_um_per_V": tuple(-w for w in view.play_w_um_per_V),
        "deadzone_s_um_per_V": tuple(-s for s in view.deadzone_s_um_per_V),
        "offset_um": -view.offset_um,
    }
    return view.model_copy(update=update)


def merged(
    at: tuple[float, ...], values: tuple[float, ...], more_at: Samples, more: Samples
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Thresholds of both and their values, rising, each threshold once; values of equal thresholds add."""
    total: dict[float, float] = {}
    for threshold, value in [*zip(at, values, strict=True), *zip(more_at.tolist(), more.tolist(), strict=True)]:
        total[threshold] = total.get(threshold, 0.0) + value
    thresholds = tuple(sorted(total))
    return thresholds, tuple(total[t] for t in thresholds)
