"""Static cross-coupling of three axes, from records in which one axis is driven at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from phaselead.identify.runs import driven_axes
from phaselead.record import AXES, Recording

CouplingMatrix = tuple[tuple[float, float, float], ...]
REST_ROWS = 5


def cross_coupling(recordings: Sequence[Recording]) -> tuple[CouplingMatrix, CouplingMatrix] | None:
    """(matrix, standard deviations), row: responding axis, column: driven axis; None without a usable record.

    Each entry is the regression of the idle axis' position on the driven one's over the scored rows of a
    record, averaged over records by the square of the driven range; its deviation is the scatter between
    records. Columns of axes never driven alone stay those of the unit matrix.
    """
    found: dict[tuple[int, int], list[tuple[float, float]]] = {}
    for recording in recordings:
        driven = driven_axes(recording)
        if len(driven) != 1 or not _complete(recording):
            continue
        column = AXES.index(driven[0])
        position = [_centred(recording, axis) for axis in AXES]
        own = position[column]
        power = float(own @ own)
        if power == 0:
            continue
        for row in range(3):
            if row != column:
                entry = (float(position[row] @ own) / power, float(np.ptp(own)) ** 2)
                found.setdefault((row, column), []).append(entry)
    if not found:
        return None
    matrix, std = np.eye(3), np.zeros((3, 3))
    for at, entries in found.items():
        values, weights = np.array(entries).T
        matrix[at] = np.average(values, weights=weights)
        spread = np.average((values - matrix[at]) ** 2, weights=weights)
        std[at] = np.sqrt(spread / max(len(values) - 1, 1))
    return _plain(matrix), _plain(std)


def decoupled(recordings: Sequence[Recording], matrix: CouplingMatrix) -> list[Recording]:
    """The recordings with what each axis sees of the others taken away, (x - rest) = matrix (own - rest).

    An axis that another has been driven before keeps a share of its remanence, which is no memory of its
    own. Where the axes stand at rest is read from the first rows of the first recording. Recordings without
    all three positions are returned as they are.
    """
    inverse = np.linalg.inv(np.array(matrix))
    complete = [r for r in recordings if _complete(r)]
    if not complete:
        return list(recordings)
    rest = np.array([[np.mean(complete[0].axes[axis].x_um[:REST_ROWS])] for axis in AXES])  # type: ignore[index]
    found = []
    for recording in recordings:
        if _complete(recording):
            own = rest + inverse @ (np.array([recording.axes[axis].x_um for axis in AXES]) - rest)
            axes = {a: replace(recording.axes[a], x_um=own[i]) for i, a in enumerate(AXES)}
            recording = replace(recording, axes=axes)
        found.append(recording)
    return found


def _complete(recording: Recording) -> bool:
    return all(a in recording.axes and recording.axes[a].x_um is not None for a in AXES)


def _centred(recording: Recording, axis: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    x = recording.axes[axis].x_um
    assert x is not None
    scored = x[recording.scored]
    return np.asarray(scored - scored.mean())


def _plain(matrix: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> CouplingMatrix:
    return tuple((float(a), float(b), float(c)) for a, b, c in matrix)
