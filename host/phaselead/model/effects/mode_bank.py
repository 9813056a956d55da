"""Many modes at once, their poles moved a little by the levels of the actuators (mode_bank.c).

A mode with the pole p = w (-zeta + j sqrt(1 - zeta^2)) is the state s' = p s + x; abs(p) s spans what it can add:
displacement w^2/(s^2 + 2 zeta w s + w^2) and velocity w s/(s^2 + 2 zeta w s + w^2) of x.
"""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np
from numpy.typing import NDArray

from phaselead.compiled import kernel_of
from phaselead.errors import BadInput
from phaselead.record import Samples

Complex = NDArray[np.complex128]
_DOUBLES = ctypes.POINTER(ctypes.c_double)
NOT_PLAYED = "modes that the axes share, which the simulator does not play; remove it, or give modes of the axis alone"
SMALL = 1e-3
"""Below this abs(p) step the differences of exponentials would cancel; a series takes their place."""


def poles(f_Hz: Samples, zeta: Samples) -> Complex:
    """(m,) in 1/s, of the upper half plane. Raises BadInput beyond critical damping."""
    if not ((f_Hz > 0).all() and (zeta > 0).all() and (zeta < 1).all()):
        raise BadInput("a mode needs f_Hz above 0 and zeta between 0 and 1")
    return np.asarray(2 * np.pi * f_Hz * (-zeta + 1j * np.sqrt(1 - zeta**2)))


def modes_of(p: Complex) -> tuple[Samples, Samples]:
    """f_Hz (m,) and zeta (m,) of poles."""
    return np.abs(p) / (2 * np.pi), -p.real / np.abs(p)


def state_weights(displacement: Samples, velocity: Samples, zeta: Samples) -> Samples:
    """(2m,): what the real and imaginary parts of the states count for shares (m,) of displacement and velocity."""
    turning = (displacement - velocity * zeta) / np.sqrt(1 - zeta**2)
    return np.stack([velocity, turning], axis=-1).reshape(*displacement.shape[:-1], -1)


def shares(weights: Samples, zeta: Samples) -> tuple[Samples, Samples]:
    """Displacement and velocity (..., m) from weights (..., 2m): the inverse of ``state_weights``."""
    velocity, turning = weights[..., 0::2], weights[..., 1::2]
    return turning * np.sqrt(1 - zeta**2) + velocity * zeta, velocity


def states(x: Samples, p: Complex, step_s: float, level: Samples | None = None, drop: Complex | None = None) -> Samples:
    """States (n, 2m), real and imaginary part of each mode, of ``x`` (n,), settled in the first row.

    ``level`` (n, axes) and ``drop`` (m, axes) move pole r to p_r (1 - sum_j drop_rj level_j).
    """
    return _run(x, p, step_s, level, drop, False)[0]


def states_and_slopes(
    x: Samples, p: Complex, step_s: float, level: Samples | None = None, drop: Complex | None = None
) -> tuple[Samples, Samples]:
    """``states``, and their derivative in p times abs(p), both (n, 2m)."""
    return _run(x, p, step_s, level, drop, True)


def _run(
    x: Samples, p: Complex, step_s: float, level: Samples | None, drop: Complex | None, slopes: bool
) -> tuple[Samples, Samples]:
    x, n, m = np.ascontiguousarray(x), len(x), len(p)
    level = np.zeros((n, 0)) if level is None else np.ascontiguousarray(level)
    drop = np.zeros((m, 0), dtype=complex) if drop is None else np.ascontiguousarray(drop)
    if level.shape != (n, drop.shape[1]) or len(drop) != m:
        raise ValueError(f"levels {level.shape} and drops {drop.shape} do not belong to {n} rows and {m} modes")
    modes, state, out = _coefficients(p, step_s), np.empty(4 * m), np.empty((n, 2 * m))
    slope = np.empty((n, 2 * m)) if slopes else np.empty((0, 0))
    _kernel().stage_modes(
        n, _at(x), step_s, m, _at(modes), level.shape[1], _at(level), _at(drop.view(np.float64)), _at(state), _at(out),
        _at(slope) if slopes else None,
    )  # fmt: skip
    return out, slope


def _coefficients(p: Complex, step_s: float) -> Samples:
    """(m, 16): the kernel's struct. Triangle hold (Franklin, Powell and Workman 1998) and its derivative in p."""
    z = p * step_s
    held, ramp, held_slope, ramp_slope = _holds(z)
    size = np.abs(p)
    values = (p, z, np.exp(z), held - ramp, ramp, held_slope - ramp_slope, ramp_slope, size + 1j * size**2)
    scale = (1.0, 1.0, 1.0, step_s, step_s, step_s**2, step_s**2, 1.0)
    table = np.stack([value * s for value, s in zip(values, scale, strict=True)], axis=1)
    return np.ascontiguousarray(table).view(np.float64)


def _holds(z: Complex) -> tuple[Complex, Complex, Complex, Complex]:
    """(e^z - 1)/z, (e^z - 1 - z)/z^2 and their derivatives."""
    near = np.abs(z) < SMALL
    far = np.where(near, 1.0, z)
    e = np.exp(far)
    held, ramp = (e - 1) / far, (e - 1 - far) / far**2
    held_slope, ramp_slope = (e - held) / far, (held - 2 * ramp) / far
    return (
        np.where(near, 1 + z / 2 + z**2 / 6, held),
        np.where(near, 1 / 2 + z / 6 + z**2 / 24, ramp),
        np.where(near, 1 / 2 + z / 3 + z**2 / 8, held_slope),
        np.where(near, 1 / 6 + z / 12 + z**2 / 40, ramp_slope),
    )


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.model._kernel", "stage_modes")
    size, double = ctypes.c_size_t, ctypes.c_double
    function = kernel.stage_modes
    function.argtypes = [size, _DOUBLES, double, size, _DOUBLES, size, *[_DOUBLES] * 5]
    function.restype = None
    return kernel


def _at(values: Samples) -> ctypes._Pointer[ctypes.c_double]:
    return values.ctypes.data_as(_DOUBLES)
