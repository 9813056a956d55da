"""The identification experiment as data: which sines, in which order, for how long."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.errors import BadInput
from phaselead.identify.checks import axis_run
from phaselead.identify.lockin import lock_in
from phaselead.identify.table_fit import table_fit
from phaselead.model import TableView
from phaselead.record import Recording

LEVELS_V = (0.5, 1.0, 2.0, 3.5, 4.5, 6.0, 8.0, 10.0)
FREQUENCIES_HZ = (1.0, 2.0, 4.0, 7.0, 10.0, 13.0, 17.0, 20.0)
HELD_OUT = ((3.0, 15.0), (5.0, 5.0))
"""The inputs on which Xu & Li 2010 verify, as (swing in V, frequency in Hz)."""


@dataclass(frozen=True)
class Experiment:
    """A sine from 0 V to ``swing_V`` on one axis, the others at 0 V."""

    axis: str
    swing_V: float
    f_Hz: float
    settle_periods: int
    measure_periods: int
    held_out: bool = False
    rest_s: float = 0.0
    """Still at 0 V before it starts."""

    @property
    def seconds(self) -> float:
        return self.rest_s + (self.settle_periods + self.measure_periods) / self.f_Hz


def plan_grid(
    axes: Sequence[str] = ("x",),
    *,
    levels_V: Sequence[float] = LEVELS_V,
    f_Hz: Sequence[float] = FREQUENCIES_HZ,
    held_out: Sequence[tuple[float, float]] = HELD_OUT,
    settle_periods: int = 1,
    measure_periods: int = 4,
    rest_s: float = 3.0,
) -> list[Experiment]:
    """The paper's grid for each axis in turn, and the inputs kept for verification.

    Levels only rise, the held-out ones at their place among them: a steady loop that grows past every earlier
    one leaves the memory above it as it was at rest, so each settled record is what a stage fresh from rest
    would come to. Only its first rise differs, so a figure *from rest* needs a device that was just opened.
    Within a level the slow sines come last, and every sine waits ``rest_s`` at 0 V: else the creep of one is
    the offset of the next, by half a per cent of the range. Raises BadInput.
    """
    if len(set(axes)) != len(axes) or not set(axes) <= {"x", "y", "z"}:
        raise BadInput(f"axes {','.join(axes)}: name each of x, y, z at most once")
    if not all(v > 0 for v in (*levels_V, *f_Hz)) or settle_periods < 0 or measure_periods < 2:
        raise BadInput("the grid needs positive levels and frequencies, and at least 2 periods to measure")
    grid = [(swing, f, False) for swing in levels_V for f in f_Hz]
    kept = [(swing, f, True) for swing, f in held_out]
    common = {(s, f) for s, f, _ in grid} & set(held_out)
    if common:
        swing, f = sorted(common)[0]
        raise BadInput(f"{swing:g} V {f:g} Hz is held out and must not be in the grid; choose another point")
    plan = []
    for axis in axes:
        for swing, f, held in sorted(kept + grid, key=lambda e: (e[0], not e[2], -e[1])):
            plan.append(Experiment(axis, swing, f, settle_periods, measure_periods, held, rest_s))
    return plan


def grid_table(recordings: Sequence[Recording], axis: str = "x") -> TableView:
    """The table view of one axis from recorded grid sines; rows before a recording's window are the settling.

    Raises BadInput when a record is no steady sine, or the grid has too few levels or frequencies.
    """
    if not recordings:
        raise BadInput("no recordings to make a table of; run the grid first")
    return table_fit([lock_in(axis_run(recording, axis)).point() for recording in recordings])


def plan_seconds(plan: Sequence[Experiment]) -> float:
    """How long the device is driven, pauses included."""
    return float(np.sum([e.seconds for e in plan]))
