"""Where the memory of each record starts: at rest, or at the turning point the stage came from before it.

Once a record has been at both ends of its voltage, nothing that it can still move remembers what was before
it (wiping-out); what is left of the past is an offset. So slopes come from settled rows first, and the
starts are told apart afterwards, by the rows before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from phaselead.identify.operator_design import FitRun
from phaselead.record import Samples

OTHER_MEMORY = 0.6
"""A record starts from another memory than rest when that leaves less than this share of its squared
residual."""
ALIKE = 1.1
"""Starts whose squared residuals are within this factor are not told apart."""
DRIFT = 0.01
"""Of the range: offsets up to this are creep or drift."""
END_SHARE = 0.01
"""Of the span: this close to the end of its voltage a record has been there."""
ENOUGH = 1 / 3
"""Of the rows: a record with fewer settled ones is used whole."""
NAMED = 3


def settled(fit: FitRun) -> FitRun:
    """The record without the rows in which it still remembers what was before it."""
    u = fit.run.u_V
    slack = END_SHARE * np.ptp(u)
    forgotten = max(int(np.argmax(u >= u.max() - slack)), int(np.argmax(u <= u.min() + slack)))
    keep = fit.rows >= forgotten
    if keep.sum() < ENOUGH * len(keep):
        return fit
    return replace(fit, rows=fit.rows[keep], groups=fit.groups[keep])


def came_from(
    fits: Sequence[FitRun], residual: Callable[[FitRun], Samples], own_offsets: bool
) -> tuple[list[FitRun], list[str]]:
    """Give each record that clearly does not start from rest the turning point that explains it best.

    ``residual`` is what the fitted slopes leave of a record (rows,) in um. Its mean tells of the memory only beyond
    what creep and drift make, and not at all with ``own_offsets``. Of turning points that explain a record alike
    the nearest to 0 V is taken: the further ones move what the record never shows. A single record defines what
    rest is.
    """
    if len(fits) < 2:
        return list(fits), []
    tries = _turning_points(fits)

    def left(fit: FitRun) -> float:
        e = residual(fit)
        beyond = 0.0 if own_offsets else max(abs(float(e.mean())) - DRIFT * fit.run.range_um, 0.0)
        return float(np.var(e)) + beyond**2

    found, odd = [], []
    for fit in fits:
        others = [replace(fit, came_from_V=v) for v in tries]
        squares = [left(other) for other in others]
        alike = [o for o, square in zip(others, squares, strict=True) if square <= ALIKE * min(squares)]
        if min(squares) < OTHER_MEMORY * left(fit):
            other = min(alike, key=lambda o: abs(o.came_from_V or 0.0))
            odd.append(f"{fit.run.source} (from {other.came_from_V:.3g} V)")
            fit = other
        found.append(fit)
    return found, _message(odd, len(fits))


def _turning_points(fits: Sequence[FitRun]) -> list[float]:
    """Voltages a record can have come from: an even grid, and the ends of every record."""
    ends = [float(end) for f in fits for end in (f.run.u_V.min(), f.run.u_V.max())]
    low, high = min(ends), max(ends)
    grid = [*np.linspace(low, high, 9).tolist(), *sorted(ends)]
    spaced: list[float] = []
    for volt in sorted(grid):
        if not spaced or volt - spaced[-1] > 0.02 * (high - low):
            spaced.append(volt)
    return spaced


def _message(odd: list[str], count: int) -> list[str]:
    if not odd:
        return []
    more = f" and {len(odd) - NAMED} more" if len(odd) > NAMED else ""
    return [f"{len(odd)} of {count} records do not start from rest: {', '.join(odd[:NAMED])}{more}"]
