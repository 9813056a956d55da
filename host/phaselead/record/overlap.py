"""Whether two recordings hold the same measurement: windows of one file that share time, or a copy of other form."""

from __future__ import annotations

import numpy as np

from phaselead.record.recording import Recording

FEWEST_ROWS = 256
"""Rows of a copy: fewer may agree by chance."""
SAME_SHARE = 1e-6
"""Of the span of a position: what printing it can change."""
SAME_TIME = 1e-3
"""Of a step between rows: what printing times can change."""


def same_measurement(a: Recording, b: Recording) -> bool:
    """Whether some scored rows of one recording are also in the other."""
    if a.sha256 and a.sha256 == b.sha256:
        return _share_time(a, b)
    return _same_at_same_times(a, b) or (_never_repeats(a) and _same_row_by_row(a, b))


def _share_time(a: Recording, b: Recording) -> bool:
    ta, tb = a.t_s[a.scored], b.t_s[b.scored]
    return bool(ta[0] <= tb[-1] and tb[0] <= ta[-1])


def _same_at_same_times(a: Recording, b: Recording) -> bool:
    early, late = (a, b) if a.t_s[a.scored][0] <= b.t_s[b.scored][0] else (b, a)
    ta, tb = early.t_s[early.scored], late.t_s[late.scored]
    start = int(np.searchsorted(ta, tb[0] - SAME_TIME / early.rate_Hz))
    count = min(len(ta) - start, len(tb))
    if count < FEWEST_ROWS or abs(ta[start] - tb[0]) > SAME_TIME / early.rate_Hz:
        return False
    first, second = (r.scored.indices(len(r.t_s))[0] for r in (early, late))
    rows = slice(first + start, first + start + count)
    return _changes(early, rows) and _equal_rows(early, late, rows, slice(second, second + count))


def _same_row_by_row(a: Recording, b: Recording) -> bool:
    return _equal_rows(a, b, a.scored, b.scored)


def _changes(record: Recording, rows: slice) -> bool:
    """Whether some position changes so often that no two measurements of the same drive agree: one that stands still,
    or goes from step to step of a coarse sensor, may look alike twice."""
    seen = [axis.x_um[rows] for axis in record.axes.values() if axis.x_um is not None]
    return any(np.count_nonzero(np.diff(x)) >= FEWEST_ROWS for x in seen)


def _never_repeats(record: Recording) -> bool:
    """Whether some position never quite repeats itself, so that only a copy is the same at other times."""
    seen = [axis.x_um[record.scored] for axis in record.axes.values() if axis.x_um is not None]
    return any(len(np.unique(np.diff(x, 2))) > len(x) // 100 for x in seen)


def _equal_rows(a: Recording, b: Recording, of_a: slice, of_b: slice) -> bool:
    """Whether every axis that both have stands at the same positions, but for printed digits."""
    shared = [n for n in a.axes if n in b.axes and a.axes[n].x_um is not None and b.axes[n].x_um is not None]
    for name in shared:
        xa, xb = a.axes[name].x_um, b.axes[name].x_um
        assert xa is not None
        assert xb is not None
        xa, xb = xa[of_a], xb[of_b]
        if xa.shape != xb.shape or np.abs(xa - xb).max() > SAME_SHARE * max(float(np.ptp(xa)), 1e-12):
            return False
    return bool(shared)
