"""What a band-limited signal does between its rows, and what is left of a finer one at them.

A record is continued by its mirror image, so that it has no edges; its ends are less exact than its middle.
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
