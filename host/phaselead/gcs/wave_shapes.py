"""The curves of WAV, point by point: LIN, RAMP, SIN_P, PNT (PI E-727 user manual, "Defining waveforms")."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phaselead.gcs.errors import Code, GcsError
from phaselead.gcs.syntax import number, whole

Points = NDArray[np.float64]
MOST_POINTS = 65536
"""Of one table."""


def segment(kind: str, words: Sequence[str]) -> tuple[int, Points]:
    """The points of one WAV command, shape (n,) in um, and the place in the table of the first, from 0.

    Raises GcsError.
    """
    if kind == "PNT":
        return _points(words)
    if kind not in ("LIN", "RAMP", "SIN_P"):
        raise GcsError(Code.WAV_TYPE_NOT_SUPPORTED, f"{kind[:20]!r}; there are LIN, RAMP, SIN_P and PNT")
    if len(words) != {"LIN": 6, "SIN_P": 6, "RAMP": 7}[kind]:
        raise GcsError(Code.WAV_PARAMETER_NR)
    length, amplitude, offset, curve, start = (
        whole(words[0]), number(words[1]), number(words[2]), whole(words[3]), whole(words[4]),
    )  # fmt: skip
    if not (curve >= 2 and start >= 0 and start + curve <= length):
        raise GcsError(Code.WAV_PARAMETER_OUT_OF_LIMIT, "the curve does not fit into its segment")
    if length > MOST_POINTS:
        raise GcsError(Code.WAV_LENGTH_EXCEEDS_LIMIT, f"{length} points; at most {MOST_POINTS}")
    if kind == "LIN":
        shares = line(curve, _within(words[5], 0, curve // 2))
    elif kind == "SIN_P":
        shares = bow(curve, _within(words[5], 1, curve - 1))
    else:
        centre = _within(words[6], 1, curve - 1)
        shares = ramp(curve, _within(words[5], 0, min(centre, curve - centre) // 2), centre)
    values = np.full(length, offset)
    values[start : start + curve] += amplitude * shares
    values[start + curve :] = offset + amplitude * (1.0 if kind == "LIN" else 0.0)
    return 0, values


def _points(words: Sequence[str]) -> tuple[int, Points]:
    if len(words) < 3:
        raise GcsError(Code.WAV_PARAMETER_NR)
    first, count = whole(words[0]), whole(words[1])
    if count != len(words) - 2:
        raise GcsError(Code.WAV_PARAMETER_NR, f"{count} points are announced, {len(words) - 2} are given")
    if not 1 <= first <= MOST_POINTS:
        raise GcsError(Code.WAV_PARAMETER_OUT_OF_LIMIT, "the first point is 1")
    return first - 1, np.array([number(word) for word in words[2:]])


def _within(word: str, low: int, high: int) -> int:
    value = whole(word)
    if not low <= value <= high:
        raise GcsError(Code.WAV_PARAMETER_OUT_OF_LIMIT, f"{value} is not {low} to {high}")
    return value


def line(points: int, bent: int) -> Points:
    """From 0 to 1 in so many points; the first and the last ``bent`` of them, up to half, speed up and slow down
    evenly."""
    t = np.linspace(0.0, 1.0, points)
    share = min(bent / (points - 1), 0.5)  # of steps, one fewer than points: where both bends meet, in the middle
    if share == 0:
        return t
    top = 1 / (1 - share)  # the speed between the bends
    rising = top * t**2 / (2 * share)
    falling = 1 - top * (1 - t) ** 2 / (2 * share)
    return np.where(t < share, rising, np.where(t > 1 - share, falling, top * (t - share / 2)))


def ramp(points: int, bent: int, centre: int) -> Points:
    """From 0 to 1, which is reached at the point ``centre``, and back."""
    up, down = line(centre + 1, bent), line(points - centre + 1, bent)
    return np.concatenate([up[:-1], 1 - down[:-1]])


def bow(points: int, centre: int) -> Points:
    """The same as two halves of a cosine."""
    k = np.arange(points)
    turns = np.where(k < centre, k / (2 * centre), 0.5 + (k - centre) / (2 * (points - centre)))
    return (1 - np.cos(2 * np.pi * turns)) / 2
