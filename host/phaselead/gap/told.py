"""Cells of a residual in plain words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from phaselead.gap.cells import AMPLITUDE, AXIS, DIRECTION, FREQUENCY, HARMONIC, STEP, steps_of
from phaselead.gap.records import Run
from phaselead.gap.result import Bound, Cell
from phaselead.model import catalogue
from phaselead.record import Samples

SHORTEST_HOLD_s = 0.05
FIRST_s = 1e-3
"""After a step, before which a hold is not looked at: modes and low-passes have that time."""
STRAIGHT = 0.3
"""Of the variance within holds, from which a line over the logarithm of time is worth a sentence."""
TRIFLE = 0.002
"""Of the unexplained power, below which it is not: the line bends little of what its level holds."""
ALIKE = (0.5, 2.0)

LEVEL = 0.01
"""Family-wise risk from which a cell stands out."""
TELLING = 0.25
ALL = "all"
"""The cell of all times after steps."""
KINDS = (HARMONIC, FREQUENCY, STEP, AXIS, AMPLITUDE, DIRECTION)
"""From the most telling."""

DIRECTIONS = {
    "rising": "is left while the voltage rises",
    "falling": "is left while the voltage falls",
    "still": "is left while the voltage stands still",
}
ORDERS = {
    "1": "is at the frequency of the drive: a wrong gain or phase",
    "2": "is the second harmonic of the drive: one half of the loop differs from the other",
    "3": "is the third harmonic of the drive: both halves of the loop are wrong alike",
}


def told(by: str, cell: str, share: float) -> str:
    """One cell as a sentence without its full stop."""
    words = {
        FREQUENCY: f"lies between {_words(cell)}",
        AMPLITUDE: f"is left while the voltage is between {_words(cell)}",
        STEP: f"comes {_words(cell, ' to ')} after a step",
        DIRECTION: DIRECTIONS.get(cell, ""),
        HARMONIC: ORDERS.get(cell, f"is harmonic {cell} of the drive"),
        AXIS: f"is on axis {cell}",
    }[by]
    return f"{100 * share:.0f} % of the unexplained power {words}"


def unit_of(unit: str) -> str:
    """A unit as it is printed: nothing for a bare number."""
    return "" if unit == "1" else unit


def percent(share: float) -> str:
    """A share of the power; what is named is never nothing."""
    return "less than 1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"


def typical_of(bound: Bound) -> float | None:
    """The typical size of what a bound is on, in its unit."""
    entry = catalogue().get(bound.name)
    return next((p.typical for p in entry.sizes if p.unit == bound.unit), None) if entry else None


def excludes(bound: Bound) -> bool:
    """Whether what is typical would have been seen; otherwise it may be there all the same."""
    typical = typical_of(bound)
    return typical is None or bound.upper_95 <= typical


def headline(cells: Sequence[Cell]) -> str | None:
    """The one sentence that says most: of the cells that stand out and hold a good part of the power, the kind that
    points at a cause soonest. None where nothing stands out."""
    telling = [c for c in cells if c.p <= LEVEL and c.share >= TELLING]
    if not telling:
        return None
    return min(telling, key=lambda c: (c.cell != ALL, KINDS.index(c.by), -c.share)).sentence


def _words(cell: str, between: str = " and ") -> str:
    return cell.replace("..", between)


@dataclass(frozen=True)
class Holds:
    """What a residual does after steps: its part of the power, and its slopes over the logarithm of time."""

    share: float
    up: float
    down: float
    """um per decade and volt of step, in the direction of the step; nan without such steps."""

    def sentence(self) -> str:
        """In words."""
        slopes = [s for s in (self.up, self.down) if np.isfinite(s)]
        along = "rise" if np.mean(slopes) > 0 else "return"
        said = f"{100 * self.share:.0f} % of the unexplained power is a slow {along} after steps"
        if len(slopes) < 2:
            return f"{said} {'up' if np.isfinite(self.up) else 'down'}"
        if self.up * self.down > 0 and ALIKE[0] < self.up / self.down < ALIKE[1]:
            return f"{said}, the same in both directions"
        if self.up * self.down < 0 and min(abs(self.up), abs(self.down)) > ALIKE[0] * max(abs(self.up), abs(self.down)):
            return (
                f"{100 * self.share:.0f} % of the unexplained power drifts one way after steps, whichever way they go"
            )
        return f"{said}, mostly after steps {'up' if abs(self.up) > abs(self.down) else 'down'}"


def holds(errors: Sequence[tuple[Run, Samples]]) -> Holds | None:
    """Regression of residuals (n,) during holds on the logarithm of time since their step, each hold with a level of
    its own; None where there are no holds or no such line."""
    power = sum(float(np.sum(e**2)) for _, e in errors)
    kept: list[tuple[float, Samples, Samples]] = []
    for run, error in errors:
        kept += _holds_of(run, error)
    if not kept or not power > 0:
        return None
    slopes = {side: _slope(kept, side) for side in (1.0, -1.0)}
    explained = within = 0.0
    level = 0.0
    for size, line, e in kept:
        fit = size * slopes[float(np.sign(size))] * (line - line.mean())
        about = e - e.mean()
        within += float(np.sum(about**2))
        explained += float(np.sum(about**2) - np.sum((about - fit) ** 2))
        level += float(np.sum((fit + e.mean()) ** 2))
    if explained < max(STRAIGHT * within, TRIFLE * power):
        return None
    return Holds(min(level / power, 1.0), slopes[1.0], slopes[-1.0])


def _slope(kept: Sequence[tuple[float, Samples, Samples]], side: float) -> float:
    up = down = 0.0
    for size, line, e in kept:
        if np.sign(size) == side:
            x = size * (line - line.mean())
            up += float(x @ e)
            down += float(x @ x)
    return up / down if down > 0 else np.nan


def _holds_of(run: Run, error: Samples) -> list[tuple[float, Samples, Samples]]:
    """Size of the step in V, log10 of the seconds since, and the residual, for every hold that is long enough."""
    found = []
    for start, stop in pairwise([*steps_of(run).tolist(), len(run.u_V)]):
        first = start + max(1, round(FIRST_s / run.step_s))
        a, b = max(first, run.start), min(stop, run.stop)
        if (b - a) * run.step_s < SHORTEST_HOLD_s or np.ptp(run.u_V[first:stop]) > 0:
            continue
        line = np.log10((np.arange(a, b) - start + 1) * run.step_s)
        found.append((float(run.u_V[start] - run.u_V[start - 1]), line, error[a - run.start : b - run.start]))
    return found
