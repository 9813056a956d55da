"""What a signal does between its rows, and what is left of a finer one at them.

A band-limited record is continued by its mirror image, so that it has no edges; its ends are less exact than its
middle.
"""

from __future__ import annotations

import numpy as np

from phaselead.record import Samples


def band_limited(x: Samples, fine: int) -> Samples:
    """``fine`` points for every row of ``x`` (n,), (n fine,), with nothing above half the rate of the rows."""
    n = len(x)
    spectrum = np.fft.rfft(np.concatenate([x, x[::-1]]))
    spectrum[-1] /= 2  # half of it belongs to the frequency below 0
    return np.asarray(fine * np.fft.irfft(spectrum, 2 * n * fine)[: n * fine])


def derivative_at_rows(y: Samples, fine: int, step_s: float) -> Samples:
    """Derivative (n,) at the rows, ``step_s`` apart, of ``y`` (n fine,) without what is above half their rate."""
    n = len(y) // fine
    spectrum = np.fft.rfft(np.concatenate([y, y[::-1]]))[: n + 1] / fine
    turn = 2j * np.pi * np.arange(n + 1) / (2 * n * step_s)
    turn[-1] = 0.0
    return np.asarray(np.fft.irfft(spectrum * turn, 2 * n)[:n])


def straight(x: Samples, fine: int) -> Samples:
    """``fine`` points for every row of ``x`` (n,), on straight lines between rows, (n fine - fine + 1,)."""
    rows = np.arange(len(x))
    return np.interp(np.arange(fine * (len(x) - 1) + 1) / fine, rows, x)


def nearest_straight(y: Samples, fine: int) -> Samples:
    """Rows (n,) of which the straight lines between them come nearest to ``y`` (n fine - fine + 1,), by least squares.

    What follows takes a signal to be straight there: a corner of it between two rows is then passed on with most of its
    area. No row leaves the range of ``y`` between its neighbours, for a memory would keep that; the first is kept.
    """
    from scipy.linalg import solveh_banded  # here, since it is slow to import

    if len(y) == 1:
        return y
    hat = 1 - np.abs(np.arange(1 - fine, fine)) / fine
    falling = hat[fine - 1 :]
    sums = np.convolve(y, hat)[fine - 1 : fine - 1 + len(y) : fine]
    normal = np.empty((2, len(sums)))
    normal[0] = falling[1:] @ falling[:0:-1]
    normal[1] = hat @ hat
    normal[1, [0, -1]] = falling @ falling
    found = np.asarray(solveh_banded(normal, sums))
    reach = np.pad(y, fine, mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(reach, 2 * fine + 1)[::fine]
    found = np.clip(found, around.min(axis=1), around.max(axis=1))
    found[0] = y[0]
    return np.asarray(found)
