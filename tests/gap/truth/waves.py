"""Voltages that a lab would apply: (n,) arrays between 0 V and the span of the stage, beginning and ending at 0 V."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]
EDGE = 0.1
"""Of a record: led in from 0 V, and out again."""
FAST_ENOUGH_HZ = 1000.0
"""Rate above which a lab sees the ringing of its stage; below it, it does not excite what it could not see."""


def rise_rows(rate_Hz: float) -> int:
    """Rows that a jump takes."""
    return 1 if rate_Hz > FAST_ENOUGH_HZ else 6


def _shaped(wave: Samples, middle_V: float, half_V: float) -> Samples:
    """``wave`` (-1..1) about a middle, led in from 0 V and out again."""
    n = len(wave)
    edge = np.arange(n) / (EDGE * n)
    ramp = np.sin(np.pi / 2 * np.clip(np.minimum(edge, edge[::-1]), 0, 1)) ** 2
    return ramp * (middle_V + half_V * wave)


def multisine(
    rng: np.random.Generator,
    span_V: float,
    rate_Hz: float,
    seconds: float,
    level: float,
    tilt: float,
    mode_Hz: float,
    top: float = 0.42,
) -> Samples:
    """Random phases on a logarithmic grid up to ``top`` of the rate, amplitudes as f^-tilt but small about the mode.

    ``level`` is the peak-to-peak share of the span.
    """
    t = np.arange(round(seconds * rate_Hz)) / rate_Hz
    grid = np.exp(np.linspace(np.log(1 / seconds), np.log(top * rate_Hz), 70)) * rng.uniform(0.97, 1.03, 70)
    lines = np.unique(np.round(grid * seconds)) / seconds
    phases = rng.uniform(0, 2 * np.pi, len(lines))
    wave = np.zeros_like(t)
    for f, phase in zip(lines, phases, strict=True):
        amplitude = f**-tilt / (1 + 4 * np.exp(-((np.log(f / mode_Hz) / 0.06) ** 2)))
        wave += amplitude * np.cos(2 * np.pi * f * t + phase)
    return _shaped(wave / np.abs(wave).max(), span_V / 2, span_V * level / 2)


def steps(
    rng: np.random.Generator, span_V: float, rate_Hz: float, seconds: float, holds: int, rise_rows: int = 1
) -> Samples:
    """Jumps of both signs with holds between them, back to 0 V for the last."""
    levels = np.where(np.arange(holds - 1) % 2, rng.uniform(0.1, 0.4, holds - 1), rng.uniform(0.55, 0.85, holds - 1))
    hold = round(seconds * rate_Hz / holds)
    corners, heights = [0.0], [0.0]
    for i, level in enumerate([*levels, 0.0]):
        start = round((i + 0.2) * hold)
        corners += [start, start + rise_rows]
        heights += [heights[-1], float(level)]
    return span_V * np.interp(np.arange(round((holds + 0.2) * hold)), corners, heights)


def triangle(rng: np.random.Generator, span_V: float, rate_Hz: float, seconds: float) -> Samples:
    """Full loops that decay about a middle of their own."""
    middle = rng.uniform(0.45, 0.55)
    sizes = np.concatenate([[1.0, 1.0], np.linspace(0.9, 0.1, 5) * rng.uniform(0.85, 1.1, 5)])
    corners = [0.0]
    for size in sizes:
        half = min(0.5 * size, 0.5)
        centre = 0.5 if size >= 1 else middle
        corners += [min(centre + half, 1.0), max(centre - half, 0.0)]
    corners.append(0.0)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)))])
    n = round(seconds * rate_Hz)
    return span_V * np.interp(np.linspace(0, way[-1], n), way, corners)


def triangles(span_V: float, rate_Hz: float, seconds: float, count: int, level: float) -> Samples:
    """From 0 V up to a level and back, always at the same rate."""
    corners = np.arange(2 * count + 1)
    n = round(seconds * rate_Hz)
    return span_V * level * np.interp(np.linspace(0, 2 * count, n), corners, corners % 2)


def loops(span_V: float, rate_Hz: float, seconds: float, f_Hz: float, level: float, middle: float) -> Samples:
    """Straight up and down about a middle, led in and out."""
    t = np.arange(round(seconds * rate_Hz)) / rate_Hz
    return _shaped(2 / np.pi * np.arcsin(np.sin(2 * np.pi * f_Hz * t)), span_V * middle, span_V * level / 2)


def sweep(span_V: float, rate_Hz: float, seconds: float, first_Hz: float, last_Hz: float, level: float) -> Samples:
    """A sine about the middle of the span whose frequency grows or falls as an exponential, led in and out."""
    t = np.arange(round(seconds * rate_Hz)) / rate_Hz
    growth = np.log(last_Hz / first_Hz) / seconds
    phase = 2 * np.pi * first_Hz * np.expm1(growth * t) / growth
    return _shaped(np.sin(phase), span_V / 2, span_V * level / 2)


def sine(span_V: float, rate_Hz: float, seconds: float, f_Hz: float, level: float, middle: float = 0.5) -> Samples:
    """One sine about a middle, led in and out."""
    t = np.arange(round(seconds * rate_Hz)) / rate_Hz
    return _shaped(-np.cos(2 * np.pi * f_Hz * t), span_V * middle, span_V * level / 2)


def idle(rate_Hz: float, seconds: float) -> Samples:
    """0 V."""
    return np.zeros(round(seconds * rate_Hz))
