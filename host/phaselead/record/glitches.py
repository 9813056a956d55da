"""Rows that stand alone far off the path: what a sensor or its line does, and no stage."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

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
PULSE = 0.01
"""Of the span of the voltage: a pulse of that which the stage may follow."""


def glitches(x_um: Samples, u_V: Samples | None = None) -> NDArray[np.intp]:
    """The rows of positions (n,) that stand alone, (k,), where the voltage (n,) does not pulse as well."""
    if len(x_um) * FEW < 1:
        return np.zeros(0, np.intp)
    off_um = _off_median(x_um)
    steps_um = np.abs(np.diff(x_um))
    step_um = float(np.min(steps_um, where=steps_um > 0, initial=np.inf))
    usual_um = max(float(np.quantile(off_um, 1 - FEW)), step_um)
    found = np.flatnonzero(off_um > FURTHER * usual_um)
    bursts = np.split(found, np.flatnonzero(np.diff(found) > APART) + 1)
    alone = [int(rows[np.argmax(off_um[rows])]) for rows in bursts if len(rows) and rows[-1] - rows[0] < NEAR]
    pulses = np.zeros(len(x_um), dtype=bool) if u_V is None else _off_median(u_V) > PULSE * np.ptp(u_V)
    kept = [i for i in alone if _off_its_neighbours(x_um, i) and not pulses[max(i - APART, 0) : i + 1].any()]
    return np.array(kept, np.intp)


def _off_median(values: Samples) -> Samples:
    """How far each row of a column (n,) is from the median of those about it."""
    from scipy.ndimage import median_filter  # slow to load, and most commands look at no positions

    return np.asarray(np.abs(values - median_filter(values, NEAR, mode="nearest")))


def _off_its_neighbours(x_um: Samples, row: int) -> bool:
    """Whether a row is off the path of those beside it, and not its turning point: these stand off one another less by
    far, but for one more glitch."""
    near = x_um[max(row - NEAR // 2 - 1, 0) : row + NEAR // 2 + 2]
    off_um = np.sort(np.abs(near - np.median(near)))
    return bool(abs(x_um[row] - np.median(near)) > FURTHER * off_um[-3])


def glitch_doubts(recordings: Iterable[Recording]) -> list[str]:
    """A line about the rows that stand alone in some recordings, and where the first is; none where there are none."""
    found: list[str] = []
    for recording in recordings:
        times_s = recording.t_s[recording.scored]
        for axis, record in recording.axes.items():
            if record.x_um is None:
                continue
            u_V = None if record.u_V is None else record.u_V[recording.scored]
            for row in glitches(record.x_um[recording.scored], u_V):
                place = (
                    f"{recording.source}: the position of axis {axis} jumps away and back at t_s = {times_s[row]:.6g}"
                )
                before_s, after_s = times_s[row - 1], times_s[min(row + 2, len(times_s) - 1)]
                found.append(f"{place}; it counts as motion: use the windows @:{before_s:.6g} and @{after_s:.6g}:")
    if not found:
        return []
    return [f"{found[0]}, or record again{more_like_it(len(found) - 1)}; is it a glitch of the sensor or its line?"]
