"""Rows that stand alone far off the path: what a sensor or its line does, and no stage."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from phaselead.errors import more_like_it
from phaselead.record.axis_record import Samples
from phaselead.record.recording import Recording

NEAR = 5
"""Rows whose median a row is compared with: two that stand off together are seen, three in a row may be motion."""
FEW = 0.001
"""Of the rows: what more of them do is noise, ringing or a drive with corners, and no glitch."""
FURTHER = 5.0
"""Times as far as all but these few stand off: of normal noise the farthest of 10^9 rows stands off 1.9 times as far as
one in 1000."""
APART = 20
"""Rows between two glitches: what goes on standing off so soon rings."""


def glitches(x_um: Samples) -> NDArray[np.intp]:
    """The rows of positions (n,) that stand alone, (k,)."""
    if len(x_um) * FEW < 1:
        return np.zeros(0, np.intp)
    off_um = np.abs(x_um - median_filter(x_um, NEAR, mode="nearest"))
    steps_um = np.abs(np.diff(x_um))
    step_um = float(np.min(steps_um, where=steps_um > 0, initial=np.inf))
    usual_um = max(float(np.quantile(off_um, 1 - FEW)), step_um)
    found = np.flatnonzero(off_um > FURTHER * usual_um)
    bursts = np.split(found, np.flatnonzero(np.diff(found) > APART) + 1)
    alone = [rows[np.argmax(off_um[rows])] for rows in bursts if len(rows) and rows[-1] - rows[0] < NEAR]
    return np.array(alone, np.intp)


def glitch_doubts(recording: Recording) -> list[str]:
    """One line for each axis of which rows stand alone."""
    found = []
    for axis, record in recording.axes.items():
        if record.x_um is not None and len(rows := glitches(record.x_um[recording.scored])):
            at_s = recording.t_s[recording.scored][rows[0]]
            found.append(
                f"{recording.source}: the position of axis {axis} jumps away and back at t_s = {at_s:.6g}"
                f"{more_like_it(len(rows) - 1)}: a glitch of the sensor or its line? It counts as motion; leave it out "
                "by a window, FILE@FROM:TO, or record again"
            )
    return found
