"""Where the memory of a record starts: at rest, or at the turning point the stage came from before it.

Once a record has been at both ends of its voltage, nothing that it can still move remembers what was before it
(wiping-out); what is left of the past is an offset. So slopes come from settled rows first, and the starting memories
are told apart afterwards, by the rows before.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phaselead.identify.operator.regressors import FitRun
from phaselead.record import Samples

OTHER_MEMORY, OTHER_BY_VARIANCE = 0.6, 0.8
"""A record starts from another memory than rest when that leaves less than the first share of its squared residual or,
where its offset says nothing of the memory, less than the second of the variance."""
ALIKE_STARTS = 1.1
"""Starts whose squared residuals are within this factor are not told apart."""
DRIFT = 0.01
"""Of the range: offsets up to this are creep or drift."""
END_SHARE = 0.01
"""Of the span: this close to the end of its voltage a record has been there."""
ENOUGH_ROWS = 1 / 3
"""Of the rows: where no record has so many settled ones, all are used whole."""
FEWEST_SETTLED = 20
"""Rows that tell the offset of a record at least."""
NAMED_RECORDS = 3
"""How many records a message names."""


def starting_memory(
    squares: Callable[[float | None], float],
    turning_points_V: Iterable[float],
    share: float = OTHER_BY_VARIANCE,
    alike: float | None = None,
) -> float | None:
    """The voltage at which the stage last turned round before a record, or None when it starts from rest.

    ``squares`` gives the squared residual of the record for a turning point in V, and for None from rest. A turning
    point is believed when it leaves less than ``share`` of what rest leaves. The one that leaves least is taken; with
    ``alike``, of those within that factor of the least the nearest to 0 V: turning points further out only move what
    the record never shows.
    """
    points = list(turning_points_V)
    found = [squares(volt) for volt in points]
    least = min(found, default=np.inf)
    if not least < share * squares(None):
        return None
    if alike is None:
        return points[found.index(least)]
    return min((p for p, square in zip(points, found, strict=True) if square <= alike * least), key=abs)


def settled_of(fits: Sequence[FitRun]) -> list[FitRun]:
    """The records without the rows in which they still remember what was before them.

    A record that is never settled would draw the operator to a memory that nobody knows yet. It stands with its last
    rows, which remember least, for the others to tell where it began; where all are like that they stand whole.
    """
    kept = [fit.rows >= _forgotten(fit) for fit in fits]
    if not any(keep.sum() >= ENOUGH_ROWS * len(keep) for keep in kept):
        return list(fits)
    return [_of_rows(fit, keep) for fit, keep in zip(fits, kept, strict=True)]


def _forgotten(fit: FitRun) -> int:
    """The first row that remembers nothing of what was before the record but an offset."""
    u = fit.run.u_V
    slack = END_SHARE * np.ptp(u)
    return max(int(np.argmax(u >= u.max() - slack)), int(np.argmax(u <= u.min() + slack)))


def _of_rows(fit: FitRun, keep: NDArray[np.bool_]) -> FitRun:
    """The record with these rows, or with its last ones where these are too few to tell its offset."""
    if keep.sum() < FEWEST_SETTLED:
        keep = np.arange(len(keep)) >= len(keep) - FEWEST_SETTLED
    return replace(fit, rows=fit.rows[keep], groups=fit.groups[keep])


def with_memories(
    fits: Sequence[FitRun], residual: Callable[[FitRun], Samples], own_offsets: bool, known: Collection[int] = ()
) -> tuple[list[FitRun], list[str]]:
    """The records, each from the memory it clearly starts from, and a message that names those not from rest.

    ``residual`` is what the fitted slopes leave of a record (rows,) in um. Its mean tells of the memory only beyond
    what creep and drift make, and not at all with ``own_offsets``. A single record defines what rest is. Those with the
    numbers ``known`` stay as they are.
    """
    if len(fits) < 2:
        return list(fits), []
    turning_points_V = _turning_points_V(fits)
    found = []
    for i, fit in enumerate(fits):
        if i in known:
            found.append(fit)
            continue

        def squares(came_from_V: float | None, fit: FitRun = fit) -> float:
            e = residual(replace(fit, came_from_V=came_from_V))
            beyond = 0.0 if own_offsets else max(abs(float(e.mean())) - DRIFT * fit.run.range_um, 0.0)
            return float(np.var(e)) + beyond**2

        came_from_V = starting_memory(squares, turning_points_V, OTHER_MEMORY, ALIKE_STARTS)
        found.append(fit if came_from_V is None else replace(fit, came_from_V=came_from_V))
    return found, told_memories(found)


def told_memories(fits: Sequence[FitRun]) -> list[str]:
    """What is said of where these records start."""
    return _message([_named(fit) for fit in fits if fit.came_from_V is not None], len(fits))


def _named(fit: FitRun) -> str:
    return f"{fit.run.source} (from {fit.came_from_V:.3g} V)"


def _turning_points_V(fits: Sequence[FitRun]) -> list[float]:
    """Voltages a record can have come from: an even grid, and the ends of every record."""
    ends = [float(end) for f in fits for end in (f.run.u_V.min(), f.run.u_V.max())]
    low, high = min(ends), max(ends)
    grid = [*np.linspace(low, high, 9).tolist(), *sorted(ends)]
    spaced: list[float] = []
    for volt in sorted(grid):
        if not spaced or volt - spaced[-1] > 0.02 * (high - low):
            spaced.append(volt)
    return spaced


def _message(elsewhere: list[str], count: int) -> list[str]:
    if not elsewhere:
        return []
    more = f" and {len(elsewhere) - NAMED_RECORDS} more" if len(elsewhere) > NAMED_RECORDS else ""
    named = f"{', '.join(elsewhere[:NAMED_RECORDS])}{more}"
    return [f"{len(elsewhere)} of {count} records do not start from rest, where each began was fitted: {named}"]
