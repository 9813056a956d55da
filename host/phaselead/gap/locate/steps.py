"""What a residual does after steps of the voltage: a line over the logarithm of time is the mark of creep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from phaselead.gap.locate.cells import steps_of
from phaselead.gap.records import GapRun
from phaselead.record import Samples

SHORTEST_HOLD_s = 0.05
FIRST_s = 1e-3
"""After a step, left out: modes and low-passes need that long."""
LEAST_FIT = 0.3
"""Share of the variance within holds that the lines must explain."""
LEAST_SLOW_SHARE = 0.002
"""Share of the unexplained power that the lines must explain."""
ALIKE_SLOPES = (0.5, 2.0)
"""Ratio of the slopes after steps up and down that counts as the same."""
ALL = "all"
"""Name of the cell of all times after steps."""


@dataclass(frozen=True)
class SlowResponse:
    """How a residual goes on after steps: its share of the power, and its slope after steps up and down."""

    share: float
    up: float
    """um per decade of time and volt of step; positive in the direction of the step, nan without such steps."""
    down: float
    """The same after steps down."""

    def sentence(self) -> str:
        """In words, without a full stop."""
        slopes = [s for s in (self.up, self.down) if np.isfinite(s)]
        along = "rise" if np.mean(slopes) > 0 else "return"
        said = f"{100 * self.share:.0f} % of the unexplained power is a slow {along} after steps"
        if len(slopes) < 2:
            return f"{said} {'up' if np.isfinite(self.up) else 'down'}"
        if self.up * self.down > 0 and ALIKE_SLOPES[0] < self.up / self.down < ALIKE_SLOPES[1]:
            return f"{said}, the same in both directions"
        less, more = sorted((abs(self.up), abs(self.down)))
        if self.up * self.down < 0 and less > ALIKE_SLOPES[0] * more:
            return (
                f"{100 * self.share:.0f} % of the unexplained power drifts one way after steps, whichever way they go"
            )
        return f"{said}, mostly after steps {'up' if abs(self.up) > abs(self.down) else 'down'}"


def slow_response(errors: Sequence[tuple[GapRun, Samples]]) -> SlowResponse | None:
    """Regression of residuals (n,) in um on the logarithm of time since a step, each hold with a level of its own.

    None where there are no holds, or where the lines explain too little of them.
    """
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
    if explained < max(LEAST_FIT * within, LEAST_SLOW_SHARE * power):
        return None
    return SlowResponse(min(level / power, 1.0), slopes[1.0], slopes[-1.0])


def _slope(kept: Sequence[tuple[float, Samples, Samples]], side: float) -> float:
    """um per decade and volt over the holds after steps up (``side`` 1) or down (-1); nan without any."""
    up = down = 0.0
    for size, line, e in kept:
        if np.sign(size) == side:
            x = size * (line - line.mean())
            up += float(x @ e)
            down += float(x @ x)
    return up / down if down > 0 else np.nan


def _holds_of(run: GapRun, error: Samples) -> list[tuple[float, Samples, Samples]]:
    """Step (V), logarithm of the seconds since then (m,) and residual (m,) in um of every hold that is long enough."""
    found = []
    for start, stop in pairwise([*steps_of(run).tolist(), len(run.u_V)]):
        first = start + max(1, round(FIRST_s / run.step_s))
        a, b = max(first, run.start), min(stop, run.stop)
        if (b - a) * run.step_s < SHORTEST_HOLD_s or np.ptp(run.u_V[first:stop]) > 0:
            continue
        line = np.log10((np.arange(a, b) - start + 1) * run.step_s)
        found.append((float(run.u_V[start] - run.u_V[start - 1]), line, error[a - run.start : b - run.start]))
    return found
