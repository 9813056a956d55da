"""First- and second-order filters that effects share: exact for an input that runs straight between its rows.

Every function takes and gives (n,) arrays whose first row is how things stood before, settled there. The loops over
the rows are in C (filters.c).
"""

from __future__ import annotations

import cmath
import ctypes
import math
from collections.abc import Sequence
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phaselead.compiled import kernel_of
from phaselead.model.operator import address, doubles
from phaselead.record import Samples

Mode = tuple[float, float, float]
"""Share of the motion, frequency in Hz, damping ratio."""


UNDONE = 1e-9
"""Of the way: what may be left of lags that are undone; each turn leaves the sum of their gains of it."""


@cache
def _kernel() -> ctypes.CDLL:
    functions = ("stage_lags", "stage_second_order", "stage_second_order_residual", "stage_behind_modes")
    kernel = kernel_of("phaselead.model._kernel", *functions)
    size, double, data = ctypes.c_size_t, ctypes.c_double, ctypes.c_void_p
    kernel.stage_lags.argtypes = [size, data, size, data, data, data]
    kernel.stage_second_order.argtypes = [size, *[data] * 4]
    kernel.stage_second_order_residual.argtypes = [size, *[data] * 4, double, size, *[data] * 2]
    kernel.stage_behind_modes.argtypes = [size, size, data, size, *[data] * 3]
    for name in functions:
        getattr(kernel, name).restype = None
    return kernel


def lags(x: ArrayLike, tau_s: Sequence[float] | Samples, gain: Sequence[float] | Samples, step_s: float) -> Samples:
    """sum_j gain_j / (tau_j s + 1) of ``x``, settled at x[0]; tau 0 passes it on."""
    x, coefficients = doubles(x), _lag_coefficients(doubles(tau_s), doubles(gain), step_s)
    states, y = np.empty(len(coefficients)), np.empty_like(x)
    _kernel().stage_lags(len(x), address(x), len(states), address(coefficients), address(states), address(y))
    return y


def without_lags(
    x: ArrayLike, tau_s: Sequence[float] | Samples, gain: Sequence[float] | Samples, step_s: float
) -> Samples:
    """The y of which ``x`` (n,) is y + ``lags`` of y, settled at x[0]. Raises ValueError for a negative gain, or gains
    that add up to 1 and more."""
    x, in_all = doubles(x), float(np.sum(gain))
    if not (np.min(gain, initial=0.0) >= 0 and in_all < 1):
        raise ValueError(f"lags of gains {gain} cannot be undone: none may be negative, and their sum must be below 1")
    first = x[0] / (1 + in_all)
    moved = x - x[0]
    lagging = np.zeros_like(moved)
    for _ in range(math.ceil(math.log(UNDONE) / math.log(in_all)) if in_all > 0 else 0):
        lagging = lags(moved - lagging, tau_s, gain, step_s)
    return np.asarray(first + moved - lagging)


def _lag_coefficients(tau_s: Samples, gain: Samples, step_s: float) -> Samples:
    """(m, 3): old, new, gain of the ramp-invariant lag."""
    rows = [
        (*_lag(step_s / float(tau)), g) if tau * 1e9 > step_s else (0.0, 1.0, g)
        for tau, g in zip(tau_s, gain, strict=True)
    ]
    return doubles(rows).reshape(-1, 3)


def _lag(ratio: float) -> tuple[float, float]:
    """Weights of the last and the new input, for ratio = step/tau."""
    if ratio < 1e-4:  # the differences below would cancel
        return ratio / 2 - ratio**2 / 3, ratio / 2 - ratio**2 / 6
    mean = -math.expm1(-ratio) / ratio
    return mean - math.exp(-ratio), 1 - mean


def second_order(x: ArrayLike, b: ArrayLike, a: ArrayLike) -> Samples:
    """sum_i b_i z^-i / sum_i a_i z^-i of ``x``, three each and a_0 = 1; settled at x[0] for a gain of 1 at 0 Hz."""
    x, b, a = doubles(x), doubles(b), doubles(a)
    if b.shape != (3,) or a.shape != (3,):
        raise ValueError(f"a second-order system has three coefficients each, not {b.shape} and {a.shape}")
    y = np.empty_like(x)
    _kernel().stage_second_order(len(x), address(x), address(b), address(a), address(y))
    return y


def second_order_residual(
    x: Samples, measured: Samples, system: tuple[Samples, Samples], step_s: float, rows: NDArray[np.uintp]
) -> tuple[float, float, float]:
    """What ``second_order`` of ``x`` with ``system`` (b, a) leaves of ``measured`` at the ascending ``rows``.

    Mean squares of that and of its change with a later answer (per s), and between them their mean product, all about
    the means.
    """
    x, measured, (b, a) = doubles(x), doubles(measured), map(doubles, system)
    rows, means = np.ascontiguousarray(rows, dtype=np.uintp), np.empty(3)
    _kernel().stage_second_order_residual(
        len(x), address(x), address(measured), address(b), address(a), step_s,
        len(rows), address(rows), address(means),
    )  # fmt: skip
    left, across, late = means.tolist()
    return left, across, late


def relaxed(x: Samples, tau_s: float, step_s: float) -> Samples:
    """1/(tau s + 1) of ``x`` (n,). With tau = 0 it is ``x``."""
    return lags(x, [tau_s], [1.0], step_s) if tau_s > 0 else x


def resonant(x: Samples, f_Hz: float, zeta: float, step_s: float) -> Samples:
    """w^2/(s^2 + 2 zeta w s + w^2) of ``x`` (n,)."""
    b, a = mode_coefficients(f_Hz * step_s, zeta)
    return second_order(x, b, a)


def relaxed_late(x: Samples, taus_s: Sequence[float], step_s: float, late_s: float) -> Samples:
    """Some first-order lags in turn of ``x`` (n,), each 1/(tau s + 1), read ``late_s`` before each row.

    ``x`` stood at its first value before. This is exact between rows too, where the way of a lag is curved; a lag of
    rows that were made late first would cut the corners of that way.
    """
    there = sorted(tau_s for tau_s in taus_s if tau_s * 1e9 > step_s)
    if len(there) < 2:
        return _relaxed_late(x, there[0] if there else 0.0, step_s, late_s)
    ratios = tuple(step_s / tau_s for tau_s in there)
    whole, part = divmod(late_s / step_s, 1.0)
    return _read_late(_lags_in_turn(x, ratios, 1.0 - part), int(whole), float(x[0]))


def _lags_in_turn(x: Samples, ratios: tuple[float, ...], seen: float) -> Samples:
    """Lags of step/tau each behind the other, read where the share ``seen`` of the row before each is over.

    Over a row z_i' = ratio_i (z_{i-1} - z_i) and z_0 = x runs straight, so that all states go on by one matrix, however
    alike the lags are.
    """
    count = len(ratios)
    start, rise = x[:-1] - x[0], np.diff(x)
    goes_on, read = _over_a_row(ratios, 1.0), _over_a_row(ratios, seen)[-1]
    states = np.zeros((count, len(x)))
    for i, row in enumerate(goes_on):
        added = np.concatenate([[0.0], row[:i] @ states[:i, :-1] + row[count] * start + row[count + 1] * rise])
        states[i] = second_order(added, np.array([1.0, 0.0, 0.0]), np.array([1.0, -row[i], 0.0]))
    y = read[:count] @ states[:, :-1] + read[count] * start + read[count + 1] * rise
    return np.asarray(x[0] + np.concatenate([[0.0], y]))


@lru_cache(maxsize=256)
def _over_a_row(ratios: tuple[float, ...], share: float) -> Samples:
    """(m, m + 2): the states of m lags in turn after a share of a row, from those at its start, the input there and
    what it rises by over the whole row. A matrix exponential (Van Loan 1978)."""
    from scipy.linalg import expm  # slow to load, and needed by several lags alone

    count = len(ratios)
    rates = np.zeros((count + 2, count + 2))
    for i, ratio in enumerate(ratios):
        rates[i, i], rates[i, i - 1 if i else count] = -ratio, ratio
    rates[count, count + 1] = 1.0
    return np.asarray(expm(rates * share))[:count]


def _relaxed_late(x: Samples, tau_s: float, step_s: float, late_s: float) -> Samples:
    """The same of one lag, or none."""
    whole, part = divmod(late_s / step_s, 1.0)
    y, seen = relaxed(x, tau_s, step_s), 1.0 - part
    if part and tau_s > 0:
        gone = -math.expm1(-seen * step_s / tau_s)
        before, last = np.concatenate([x[:1], x[:-1]]), np.concatenate([y[:1], y[:-1]])
        y = last + (before - last) * gone + (x - before) * (seen - gone * tau_s / step_s)
    elif part:
        y = part * np.concatenate([x[:1], x[:-1]]) + seen * x
    return _read_late(y, int(whole), float(x[0]))


def _read_late(y: Samples, rows: int, before: float) -> Samples:
    """(n,), so many rows later."""
    rows = min(rows, len(y))
    return np.concatenate([np.full(rows, before), y[: len(y) - rows]])


def behind_modes(still_um: ArrayLike, modes: Sequence[Mode], step_s: float) -> Samples:
    """(n,) or columns (n, k): what modes make of a motion that they would follow at rest."""
    x, carried = doubles(still_um), modes_in_C(tuple(modes), step_s)
    k = x.size // max(len(x), 1)
    states, y = np.empty(2 * len(carried) * k), np.empty_like(x)
    _kernel().stage_behind_modes(len(x), k, address(x), len(carried), address(carried), address(states), address(y))
    return y


@lru_cache(maxsize=256)
def modes_in_C(modes: tuple[Mode, ...], step_s: float) -> Samples:
    """(m, 7): share, b and a of every mode whose share is not 0, as the kernels read them. Kept, so not to be written
    to."""
    rows = [(c, *(v for part in mode_coefficients(f_Hz * step_s, zeta) for v in part)) for c, f_Hz, zeta in modes if c]
    found = np.array(rows, dtype=np.float64).reshape(-1, 7)
    found.setflags(write=False)
    return found


def smoothly_relaxed(x: Samples, tau_s: float, step_s: float) -> Samples:
    """1/(tau s + 1) of ``x`` (n,), which is smooth: between rows it runs on parabolas through its neighbours."""
    straight = relaxed(x, tau_s, step_s)
    if not tau_s > 0:
        return straight
    padded = np.pad(x, (1, 2), mode="edge")
    bend = (padded[3:] - padded[2:-1] - padded[1:-2] + padded[:-3]) / 2  # (n,): of the stretch after each row
    ratio = step_s / tau_s
    # Twice what bend/2 s (1 - s), s from 0 to 1 over the row, takes away at the row's end, seen through the decay.
    decay = math.exp(-ratio)
    taken = decay * (1 / (2 * ratio) + 1 / ratio**2) + 1 / (2 * ratio) - 1 / ratio**2
    added = np.concatenate([[0.0], -taken * bend[:-1]])
    return np.asarray(straight + second_order(added, np.array([1.0, 0.0, 0.0]), np.array([1.0, -decay, 0.0])))


@lru_cache(maxsize=256)
def mode_coefficients(turns_per_step: float, zeta: float) -> tuple[Samples, Samples]:
    """(b, a) of a ramp-invariant mode of gain 1: exact states under an input that is linear over each step
    (Franklin, Powell and Workman 1998: triangle-hold equivalent).

    The states are the position and its rate over w; phi = [[c + z s, s], [-s, c - z s]] takes them over a step.
    """
    w = 2 * math.pi * turns_per_step
    damped = w * cmath.sqrt(1 - zeta**2)  # imaginary beyond critical damping
    c, s = _turned(damped, zeta * w)
    s *= w
    held = 1 - c - zeta * s, s
    ramp = (w - s - 2 * zeta * held[0]) / w, held[0] / w
    # state' = phi state + (held - ramp) x_k + ramp x_{k+1}; its answer is the first state, C (zI - phi)^-1 B.
    old, new = (held[0] - ramp[0], held[1] - ramp[1]), ramp
    stays, mixes = c - zeta * s, s
    b = new[0], old[0] - stays * new[0] + mixes * new[1], mixes * old[1] - stays * old[0]
    return np.array(b), np.array([1.0, -2 * c, math.exp(-2 * zeta * w)])


def _turned(angle: complex, decay: float) -> tuple[float, float]:
    """exp(-decay) times cos(angle) and sin(angle) / angle, both real."""
    if abs(angle.imag) < 1.0:
        shrunk = math.exp(-decay)
        return shrunk * cmath.cos(angle).real, shrunk * (cmath.sin(angle) / angle).real if angle else shrunk
    # Far beyond critical damping cos and sin overflow, their products with the decay do not.
    one, other = cmath.exp(1j * angle - decay), cmath.exp(-1j * angle - decay)
    return ((one + other) / 2).real, ((one - other) / (2j * angle)).real
