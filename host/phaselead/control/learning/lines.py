"""The error of a periodic path by the lines of its period."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from phaselead.record import Samples
from phaselead.waveforms import POINTS

Amplitudes = NDArray[np.complex128]
Numbers = NDArray[np.int64]
MOST_LINES = POINTS // 4
"""A line of a period that is played from points needs four of them: joined by straight lines they keep 81 % of it,
sinc^2(1/4)."""
HEARD = 3.0
"""Deviations above its noise from which on an error is worth a trial."""
PIECE_ROWS = 2**13
"""Rows of a record that are worked on at a time: with 257 lines 34 MB."""
NEIGHBOURS = 5
"""Lines on either side that share a figure of the noise, which is broad: with four periods one line alone has but three
differences to tell it from."""


@dataclass(frozen=True)
class Lines:
    """Complex amplitudes (m,) of the error over whole periods, a_k cos(2 pi k f t) - b_k sin(...) as a_k + i b_k, and
    the variances (m,) of these means: what changes from period to period."""

    number: Numbers
    amplitude: Amplitudes
    variance: Samples

    def times(self, factor: Amplitudes) -> Self:
        """What a linear system of this response (m,) makes of them."""
        return replace(self, amplitude=self.amplitude * factor, variance=self.variance * np.abs(factor) ** 2)

    def only(self, kept: NDArray[np.bool_]) -> Self:
        """Those that are kept (m,), 0 for the others."""
        return replace(self, amplitude=np.where(kept, self.amplitude, 0), variance=np.where(kept, self.variance, 0))

    @property
    def power(self) -> float:
        """Mean square of what repeats."""
        return float(np.sum(np.abs(self.amplitude) ** 2 * np.where(self.number == 0, 1, 0.5)))

    @property
    def heard(self) -> Amplitudes:
        """Those above their noise (m,), 0 for the others."""
        return np.where(np.abs(self.amplitude) > HEARD * np.sqrt(self.variance), self.amplitude, 0)

    @property
    def coherence(self) -> Samples:
        """Share of each line's power that repeats from period to period, 0 to 1, shape (m,)."""
        power = np.abs(self.amplitude) ** 2
        return np.asarray(np.maximum(power - self.variance, 0) / np.maximum(power, np.finfo(float).tiny))


def error_lines(t_s: Samples, error_um: Samples, f_Hz: float, count: int, rate_Hz: float) -> Lines:
    """Lines 0 to ``count`` of the error (n,) over the whole periods in the record, counted from its end.

    Raises ValueError for less than two periods.
    """
    number = np.arange(count + 1)
    per_period = rate_Hz / f_Hz
    periods = int(len(t_s) / per_period + 1e-9)
    if periods < 2:
        raise ValueError("lines need two periods or more")
    ends = len(t_s) - np.rint(np.arange(periods, -1, -1) * per_period).astype(int)
    each = np.array([_lines(t_s[a:b], error_um[a:b], f_Hz, number) for a, b in pairwise(ends)])
    scatter = np.sum(np.abs(each - each.mean(axis=0)) ** 2, axis=0) / (periods - 1) / periods
    return Lines(number, each.mean(axis=0), _smoothed(scatter))


def _lines(t_s: Samples, error_um: Samples, f_Hz: float, number: Numbers) -> Amplitudes:
    found = np.zeros(len(number), dtype=np.complex128)
    for rows in _pieces(len(t_s)):
        found += np.exp(-2j * np.pi * f_Hz * np.outer(number, t_s[rows])) @ error_um[rows]
    return found * np.where(number == 0, 1, 2) / len(t_s)


def _pieces(n: int) -> list[slice]:
    """Rows at a time: a slow path has millions, and hundreds of lines."""
    return [slice(a, min(a + PIECE_ROWS, n)) for a in range(0, n, PIECE_ROWS)]


def rest_of(lines: Lines, t_s: Samples, error_um: Samples, f_Hz: float) -> Samples:
    """The error (n,) without its lines."""
    rest = error_um.astype(np.float64)
    for rows in _pieces(len(t_s)):
        turns = np.exp(2j * np.pi * f_Hz * np.outer(t_s[rows], lines.number))
        rest[rows] -= (turns @ lines.amplitude).real
    return rest


def _smoothed(variance: Samples) -> Samples:
    """The mean over neighbours; the level, which drifts, stands for itself."""
    padded = np.pad(variance[1:], NEIGHBOURS, mode="reflect") if len(variance) > 2 * NEIGHBOURS else None
    if padded is None:
        return np.append(variance[:1], np.full(len(variance) - 1, variance[1:].mean() if len(variance) > 1 else 0.0))
    width = 2 * NEIGHBOURS + 1
    return np.append(variance[:1], np.convolve(padded, np.full(width, 1 / width), mode="valid"))


def values_of(number: Numbers, amplitude: Amplitudes, points: int = POINTS) -> Samples:
    """One period of the sum of lines (m,), shape (points,)."""
    spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
    spectrum[number] = amplitude * np.where(number == 0, points, points / 2)
    values: Samples = np.fft.irfft(spectrum, points)
    return values
