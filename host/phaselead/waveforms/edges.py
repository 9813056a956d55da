"""Edges between levels: least-jerk changes that take a share of the time between two of them."""

from __future__ import annotations

import numpy as np

from phaselead.waveforms.waveform import Shares

EDGE_SHARE = 0.1
"""Of the time at a level: how long the change to it takes."""


def least_jerk(s: Shares) -> Shares:
    """10 s^3 - 15 s^4 + 6 s^5 between 0 and 1 (Flash and Hogan 1985), 0 before and 1 after, same shape."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def stairs(turns: Shares, levels: Shares) -> Shares:
    """A period through ``levels`` (n,), each for 1/n of it, at ``turns`` from 0 to 1, same shape. The change to a level
    takes the first tenth of its time; the period begins at the last one."""
    place = np.asarray(turns, np.float64) * len(levels)
    at = np.minimum(place.astype(np.intp), len(levels) - 1)
    before = levels[at - 1]
    return np.asarray(before + (levels[at] - before) * least_jerk((place - at) / EDGE_SHARE))
