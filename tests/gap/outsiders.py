"""Small systems that a piezo catalogue was not written for, each integrated in its own few lines: a mode, a hardening
spring, a gear with backlash, a tank that overflows. Shares no code with the package."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable

import numpy as np

from phaselead.record.recording import AxisRecord, Recording

FINE = 4
"""Steps of integration per row."""

System = Callable[[np.ndarray, float], np.ndarray]
"""Takes a voltage (n,) from 0 V on and the time between rows, gives the position (n,) from rest."""


def mode(u: np.ndarray, step_s: float, *, f_Hz: float = 69.0, zeta: float = 0.02, hard: float = 0.0) -> np.ndarray:
    """A mass on a spring, 20 um/V; ``hard`` is the share by which the spring is stiffer at 100 um."""
    w, h, z, v, found = 2 * math.pi * f_Hz, step_s / FINE, 0.0, 0.0, []
    for push in (20.0 * u).tolist():
        found.append(z)
        for _ in range(FINE):
            v += h * (w * w * (push - z - hard * z * (z / 100.0) ** 2) - 2 * zeta * w * v)
            z += h * v
    return np.array(found)


def hardening(u: np.ndarray, step_s: float) -> np.ndarray:
    """The mode on a spring that grows stiffer."""
    return mode(u, step_s, hard=0.05)


def gear(u: np.ndarray, step_s: float, *, slack_um: float = 8.0) -> np.ndarray:
    """A damped mode behind a gear whose teeth have slack."""
    motor, load, taken = 20.0 * u, 0.0, []
    for at in motor.tolist():
        load = min(max(load, at - slack_um), at + slack_um)
        taken.append(load)
    return mode(np.array(taken) / 20.0, step_s, f_Hz=45.0, zeta=0.2)


def tank(u: np.ndarray, step_s: float) -> np.ndarray:
    """Level in um of a tank with an orifice, filled by a pump that turns one way; it overflows at 90 um."""
    level, found = 0.0, []
    for flow in np.maximum(u, 0.0).tolist():
        found.append(level)
        for _ in range(FINE):
            level = min(max(level + step_s / FINE * (60.0 * flow - 25.0 * math.sqrt(max(level, 0.0))), 0.0), 90.0)
    return np.array(found)


def upside_down(u: np.ndarray, step_s: float) -> np.ndarray:
    """The mode seen by a sensor that counts backwards."""
    return -mode(u, step_s)


def noisy(seconds: float, rate_Hz: float, band: tuple[float, float], seed: int) -> np.ndarray:
    """A multisine of random phases between 0 and 8 V, from and to 0 V."""
    t = np.arange(round(seconds * rate_Hz)) / rate_Hz
    lines = np.arange(max(1, round(band[0] * seconds)), round(band[1] * seconds) + 1) / seconds
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines))
    wave = np.zeros(len(t))
    for f, phase in zip(lines, phases, strict=True):
        wave += np.cos(2 * np.pi * f * t + phase)
    ramp = np.clip(np.minimum(t, t[-1] - t) / (0.05 * seconds), 0.0, 1.0)
    return ramp * 4.0 * (1 + wave / np.abs(wave).max())


def record(system: System, u: np.ndarray, rate_Hz: float, seed: int, noise_um: float = 0.02) -> Recording:
    """What a sensor with white noise and an offset sees of it."""
    rng = np.random.default_rng(1000 + seed)
    x = system(u, 1 / rate_Hz) + rng.normal(0, noise_um, len(u)) + rng.uniform(-3, 3)
    digest = hashlib.sha256(x.tobytes()).hexdigest()
    t = 100.0 * seed + np.arange(len(u)) / rate_Hz
    return Recording(t_s=t, axes={"x": AxisRecord(u, x)}, source=f"{seed}.csv", sha256=digest)


def records(
    system: System,
    count: int = 3,
    seconds: float = 3.0,
    rate_Hz: float = 1000.0,
    band: tuple[float, float] = (0.5, 150),
) -> list[Recording]:
    """Broadband records of a system, each with phases of its own."""
    return [record(system, noisy(seconds, rate_Hz, band, seed), rate_Hz, seed) for seed in range(count)]
