"""Regressors: what each effect would add to the position.

An effect is simulated at a few shapes; each shape is a group of columns, one per size parameter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from phaselead.gap.parameters import SizedEffect, bounded
from phaselead.gap.residual import ModelledRun
from phaselead.model import Effect, Parameter
from phaselead.record import Samples

GRID_POINTS = 5
"""Values of one shape parameter between its bounds."""
MODE_GRID_RATIO, MODE_GRID_ZETA = 1.16, 0.08
"""A mode is looked for at frequencies in this ratio, with this damping: neighbours then overlap."""
LONGEST_TIME, SHORTEST_TIME = 30.0, 0.5
"""A time constant is looked for up to this many lengths of the longest record, and from this part of a row on: a slower
one is a straight line, a faster one none."""


@dataclass(frozen=True)
class RegressorGroup:
    """One effect at one shape: a column for each of its size parameters."""

    effect: Effect
    shapes: Mapping[str, float]
    steps: tuple[float, ...]
    """Per column the size at which it is simulated."""

    def params(self, amounts: Sequence[float]) -> dict[str, float]:
        """All parameters of the effect when its columns are taken ``amounts`` times (in order, as many as columns)."""
        sizes = {p.name: a * s for p, a, s in zip(self.effect.sizes, amounts, self.steps, strict=True)}
        return {**self.shapes, **sizes}

    def entry(self, amounts: Sequence[float]) -> SizedEffect:
        """The effect with these parameters, within its range."""
        return self.effect, bounded(self.effect, self.params(amounts))

    def alone(self, column: int, times: float = 1.0) -> list[float]:
        """The amounts in which one column is taken so many times, and none of the others."""
        return [times if i == column else 0.0 for i in range(len(self.steps))]

    def columns(self, modelled: ModelledRun, base_um: Samples) -> Samples:
        """Columns (n, sizes) in um over the scored rows: what one step of each size adds to ``base_um`` (n,), the
        answer of the model."""
        each = [(self.effect, self.params(self.alone(i))) for i in range(len(self.steps))]
        return np.stack([modelled.answer([one]) - base_um for one in each], axis=1)


def regressor_groups(effects: Sequence[Effect], step_s: float, longest_s: float) -> list[RegressorGroup]:
    """The groups of every effect, shapes limited to what records of this sampling step and length can show."""
    found = []
    for effect in effects:
        grids = [_grid(p, effect, step_s, longest_s) for p in effect.shapes]
        steps = typical_sizes(effect)
        for point in product(*grids):
            shapes = {p.name: v for p, v in zip(effect.shapes, point, strict=True)}
            if all(shapes[first] < shapes[last] for first, last in pairwise(effect.rising)):
                found.append(RegressorGroup(effect, shapes, steps))
    return found


def typical_sizes(effect: Effect) -> tuple[float, ...]:
    """Of each of its sizes."""
    return tuple(p.typical for p in effect.sizes)


def _grid(p: Parameter, effect: Effect, step_s: float, longest_s: float) -> list[float]:
    """Values at which one shape parameter is simulated."""
    low, high = p.low, p.high
    if p.between_forms:
        return sorted({low, p.typical, high})
    if p.unit == "Hz":
        low = min(max(low, 1 / longest_s), high)
    if p.unit == "s":
        low, high = max(low, SHORTEST_TIME * step_s), min(high, LONGEST_TIME * longest_s)
        high = max(low, high)
    if effect.peak is not None and p.name == effect.peak[1]:
        return [MODE_GRID_ZETA]
    if effect.peak is not None and p.name == effect.peak[0]:
        count = max(2, int(np.log(high / low) / np.log(MODE_GRID_RATIO)))
        return [float(v) for v in np.geomspace(low, high, count)]
    if len(effect.shapes) > 1 and p is not effect.shapes[0]:
        return [float(np.clip(p.typical, low, high))]
    if p.log:
        return [float(v) for v in np.geomspace(low, high, GRID_POINTS)]
    return [float(v) for v in np.linspace(low, high, GRID_POINTS)]
