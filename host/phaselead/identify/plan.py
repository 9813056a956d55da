"""Which sines identify a stage: the paper's grid, or one of other levels, frequencies and length."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phaselead.errors import BadInput
from phaselead.record import AXES

LEVELS_V = (0.5, 1.0, 2.0, 3.5, 4.5, 6.0, 8.0, 10.0)
FREQUENCIES_HZ = (1.0, 2.0, 4.0, 7.0, 10.0, 13.0, 17.0, 20.0)
HELD_OUT = ((3.0, 15.0), (5.0, 5.0))
"""The inputs on which Xu & Li 2010 verify, as (swing in V, frequency in Hz)."""
FEWEST = 3
"""Levels and frequencies that a table view takes (Xu & Li 2010, eqs. 6 to 8: three coefficients along each)."""
RINGS_S = 0.4
"""Before a sine above the paper's frequencies is measured: a mode of 100 Hz with a damping of 0.02 keeps 0.7 %
of what its begin rings. Slower sines hardly ring it, and settle in one period."""
REST_S = 3.0
AROUND_S = 0.24
"""Of the device's time that a record takes beside its rest and its periods: stream and paths are set up, and it parks.
Measured on a virtual stage; a line adds its delays."""
WAIT_S, HOLD_S = 40.0, 12.0
"""Of the hold that shows creep: at rest before, four times its slowest lag, and held."""
HELD_S = WAIT_S + HOLD_S + AROUND_S
"""What it takes, an axis."""
SAME = 0.02
"""Levels or frequencies closer than this, relatively, are one to a fit."""


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
    def name(self) -> str:
        """Of its recording."""
        return f"{self.axis}-{self.swing_V:g}V-{self.f_Hz:g}Hz"

    @property
    def seconds(self) -> float:
        """Of its pause and its sine."""
        return self.rest_s + (self.settle_periods + self.measure_periods) / self.f_Hz


def plan_grid(
    axes: Sequence[str] = ("x",),
    *,
    levels_V: Sequence[float] = LEVELS_V,
    f_Hz: Sequence[float] = FREQUENCIES_HZ,
    held_out: Sequence[tuple[float, float]] = HELD_OUT,
    settle_periods: int = 1,
    measure_periods: int = 4,
    rest_s: float = REST_S,
) -> list[Experiment]:
    """The paper's grid for each axis in turn, and the inputs kept for verification.

    Levels only rise, the held-out ones at their place among them: a steady loop that grows past every earlier
    one leaves the memory above it as it was at rest, so each settled record is what a stage fresh from rest
    would come to. Only its first rise differs, so a figure *from rest* needs a device that was just opened.
    Within a level the slow sines come last, and every sine waits ``rest_s`` at 0 V: else the creep of one is
    the offset of the next, by half a per cent of the range. Raises BadInput.
    """
    if len(set(axes)) != len(axes) or not set(axes) <= set(AXES):
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
            settle = max(settle_periods, math.ceil(RINGS_S * f)) if f > FREQUENCIES_HZ[-1] else settle_periods
            plan.append(Experiment(axis, swing, f, settle, measure_periods, held, rest_s))
    return plan


def name_of_hold(axis: str) -> str:
    """Of the recording that shows the creep of an axis: in a folder of its own, since a fit of the sines has no use for
    it."""
    return f"creep/{axis}-hold"


def plan_seconds(plan: Sequence[Experiment], holds: Sequence[str] = ()) -> float:
    """How long it takes of the device's time, pauses and the ``holds`` of these axes included."""
    return float(np.sum([e.seconds + AROUND_S for e in plan])) + HELD_S * len(holds)


def plan_of(
    axes: Sequence[str] = ("x",),
    *,
    levels_V: Sequence[float] | None = None,
    f_Hz: Sequence[float] | None = None,
    u_max_V: float | None = None,
    duration_s: float | None = None,
    creep: bool = False,
) -> list[Experiment]:
    """The grid as a user wants it. ``u_max_V`` scales the paper's levels so that the largest is this; ``duration_s``
    thins the grid evenly until it takes no longer, with ``creep`` the hold of each axis included. The held-out inputs
    stand at the same shares of the largest level and the highest frequency as the paper's. Raises BadInput.
    """
    _refuse_nonsense(levels_V, f_Hz, u_max_V, duration_s)
    top_V = u_max_V if u_max_V is not None else max(levels_V or LEVELS_V)
    levels = _apart(levels_V or [top_V * (v / LEVELS_V[-1]) for v in LEVELS_V])
    if levels[-1] > top_V:
        raise BadInput(f"a level of {levels[-1]:g} V is above --u-max {top_V:g} V; give one of the two")
    frequencies = _apart(f_Hz or FREQUENCIES_HZ)
    swings = _between([swing * top_V / LEVELS_V[-1] for swing, _ in HELD_OUT], levels)
    rates = _between([f * frequencies[-1] / FREQUENCIES_HZ[-1] for _, f in HELD_OUT], frequencies)
    held_out = list(dict.fromkeys(zip(swings, rates, strict=True)))

    def grid(chosen_V: Sequence[float], chosen_Hz: Sequence[float]) -> list[Experiment]:
        return plan_grid(axes, levels_V=chosen_V, f_Hz=chosen_Hz, held_out=held_out)

    chosen, holds = grid(levels, frequencies), axes if creep else ()
    while duration_s is not None and plan_seconds(chosen, holds) > duration_s:
        if max(len(levels), len(frequencies)) <= FEWEST:
            held, left_out = (" with its holds for creep", " or creep (--no-creep)") if creep else ("", "")
            raise BadInput(
                f"--duration {duration_s:g}: the smallest grid of these levels and frequencies takes "
                f"{math.ceil(plan_seconds(chosen, holds))} s{held}; allow that, or leave slow frequencies{left_out} out"
            )
        if len(levels) >= len(frequencies):
            levels = thinned(levels)
        else:
            frequencies = thinned(frequencies)
        chosen = grid(levels, frequencies)
    return chosen


def plan_as_time_allows(
    axes: Sequence[str], *, creep: bool | None, duration_s: float | None, **wishes: Any
) -> tuple[list[Experiment], bool, str | None]:
    """The grid of these ``wishes`` (see ``plan_of``), whether creep is measured after it, and what to say about that.

    It is unless ``creep`` is False, or None and the sines leave no time for it in ``duration_s``: a thinner grid costs
    more than creep brings. Raises BadInput.
    """
    chosen = plan_of(axes, duration_s=duration_s, creep=creep is True, **wishes)
    if creep is not None or duration_s is None or plan_seconds(chosen, axes) <= duration_s:
        return chosen, creep is not False, None
    said = f"{duration_s:g} s leave no time for creep, which takes {HELD_S:.0f} s an axis beside the sines"
    return chosen, False, f"{said}: it is left out"


def thinned(values: Sequence[float]) -> list[float]:
    """One value less, the ends kept: the inner one whose neighbours are closest to each other, as ratios."""
    gaps = [values[i + 1] / values[i - 1] for i in range(1, len(values) - 1)]
    least = 1 + int(np.argmin(gaps))
    return [value for i, value in enumerate(values) if i != least]


def _apart(values: Sequence[float]) -> list[float]:
    """Sorted, those that print alike once: records are named by them."""
    return list({f"{value:g}": value for value in sorted(values)}.values())


def _between(wanted: Sequence[float], grid: Sequence[float]) -> list[float]:
    """Each value where it lies between two of the grid, else the middle of the nearest pair that is not taken: what is
    held out is inside what was fitted, and no point of it."""
    found: list[float] = []
    for value in wanted:
        inside = grid[0] < value < grid[-1] and all(abs(value / point - 1) > SAME for point in grid)
        middles = [float(f"{(low * high) ** 0.5:.4g}") for low, high in itertools.pairwise(grid)]
        free = [middle for middle in middles if middle not in found] or middles or [value]
        found.append(value if inside else min(free, key=lambda middle: abs(middle - value)))
    return found


def _refuse_nonsense(
    levels_V: Sequence[float] | None, f_Hz: Sequence[float] | None, u_max_V: float | None, duration_s: float | None
) -> None:
    numbers = (
        ("--levels", levels_V, "V"), ("--frequencies", f_Hz, "Hz"),
        ("--u-max", None if u_max_V is None else (u_max_V,), "V"),
        ("--duration", None if duration_s is None else (duration_s,), "s"),
    )  # fmt: skip
    for name, values, unit in numbers:
        if values is not None and not (values and all(np.isfinite(v) and v > 0 for v in values)):
            shown = ",".join(f"{v:g}" for v in values) or "nothing"
            raise BadInput(f"{name} {shown}: give numbers above 0 in {unit}")
