"""First- and second-order systems, exact for an input that runs straight between its rows, settled at the first."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from phaselead.effects.effect import Samples
from phaselead.effects.native import lags, second_order


def relaxed(x: Samples, tau_s: float, step_s: float) -> Samples:
    """1/(tau s + 1) of ``x`` (n,). With tau = 0 it is ``x``."""
    return lags(x, [tau_s], [1.0], step_s) if tau_s > 0 else x


def resonant(x: Samples, f_Hz: float, zeta: float, step_s: float) -> Samples:
    """w^2/(s^2 + 2 zeta w s + w^2) of ``x`` (n,)."""
    b, a = _mode(f_Hz * step_s, zeta)
    return second_order(x, b, a)


@lru_cache(maxsize=256)
def _mode(turns_per_step: float, zeta: float) -> tuple[Samples, Samples]:
    """Ramp-invariant mode: exact states under an input that is linear over each step (Franklin, Powell and
    Workman 1998: triangle-hold equivalent)."""
    w = 2 * np.pi * turns_per_step
    system, drive = np.array([[0.0, w], [-w, -2 * zeta * w]]), np.array([0.0, w])
    inverse = np.array([[-2 * zeta, -1.0], [1.0, 0.0]]) / w
    damped = w * np.emath.sqrt(1 - zeta**2)  # imaginary beyond critical damping
    decay, turn, sine = np.exp(-zeta * w), np.real(np.cos(damped)), np.real(np.sinc(damped / np.pi))
    phi = decay * (turn * np.eye(2) + sine * (system + zeta * w * np.eye(2)))
    held = inverse @ (phi @ drive - drive)
    ramp = inverse @ (held - drive)
    # state' = phi state + (held - ramp) x_k + ramp x_{k+1}; the output is the first state.
    a = np.array([1.0, -np.trace(phi), np.linalg.det(phi)])
    old, new = held - ramp, ramp
    # C (zI - phi)^-1 B = (adj row) B / det, for B = new z + old
    b = np.array(
        [
            new[0],
            old[0] - phi[1, 1] * new[0] + phi[0, 1] * new[1],
            -phi[1, 1] * old[0] + phi[0, 1] * old[1],
        ]
    )
    return b, a
