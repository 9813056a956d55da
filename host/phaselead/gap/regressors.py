"""Regressors: what each effect, and each thing that may be wrong with the base, would add to the position.

An effect is simulated at a few shapes; each shape is a group of columns, one per size parameter. The columns of the
base model say what refitting it could absorb.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from phaselead.gap.residual import ModelledRun
from phaselead.identify import play_thresholds
from phaselead.model import AxisModel, Effect, Parameter, Params, Place, Signal, plays
from phaselead.record import Samples

GRID_POINTS = 5
"""Values of one shape parameter between its bounds."""
MODE_GRID_RATIO, MODE_GRID_ZETA = 1.16, 0.08
"""A mode is looked for at frequencies in this ratio, with this damping: neighbours then overlap."""
LONGEST_TIME, SHORTEST_TIME = 30.0, 0.5
"""A time constant is looked for up to this many lengths of the longest record, and from this part of a row on: a slower
one is a straight line, a faster one none."""
BASE_PLAYS, BASE_SEGMENTS = 10, 8
"""How finely a refit of the base's operator is described."""
RICH_PLAYS, RICH_SEGMENTS, RICH_STD = 24, 12, 0.1
"""An operator richer than any base, and the prior deviation of its weights, as a share of the mean slope."""
GAIN_STD, PLAY_STD = 0.05, 0.02
"""How far gain and plays of a fitted base can be off where no reference record says better, of its mean slope."""
OPEN_STD = 0.3
"""The same of plays that are fitted anew with every effect."""


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

    def columns(self, modelled: ModelledRun, base_um: Samples) -> Samples:
        """Columns (n, sizes) in um over the scored rows: what one step of each size adds to ``base_um`` (n,), the
        answer of the model."""
        found = []
        for i in range(len(self.steps)):
            amounts = [float(i == j) for j in range(len(self.steps))]
            found.append(modelled.answer([(self.effect, self.params(amounts))]) - base_um)
        return np.stack(found, axis=1)


def regressor_groups(effects: Sequence[Effect], step_s: float, longest_s: float) -> list[RegressorGroup]:
    """The groups of every effect, shapes limited to what records of this sampling step and length can show."""
    found = []
    for effect in effects:
        grids = [_grid(p, effect, step_s, longest_s) for p in effect.shapes]
        steps = typical_sizes(effect)
        for point in product(*grids):
            shapes = {p.name: v for p, v in zip(effect.shapes, point, strict=True)}
            if _ordered(effect, shapes):
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


def _ordered(effect: Effect, shapes: Mapping[str, float]) -> bool:
    """Whether the shapes that must rise do so."""
    return all(shapes[first] < shapes[last] for first, last in pairwise(effect.rising))


def base_columns(modelled: ModelledRun, open_plays: bool) -> Samples:
    """Columns (n, k) in um: one prior deviation of each thing that a refit of the base could change, as it looks behind
    the base's own effects. A base without plays has no plays to refit, one without dead zones no dead zones.

    ``open_plays``: they were fitted to the training records themselves, and move with every effect that is added.
    """
    view = modelled.axis.time
    assert view is not None
    signal = modelled.chain.signal_at(Place.AMPLIFIER)
    v = view.field.of(signal.value)
    slope = mean_slope(modelled.axis)
    low, high = map(view.field.at, view.u_range_V)
    columns = [GAIN_STD * slope * v]
    if view.play_r_V:
        r = play_thresholds(high - low, BASE_PLAYS)
        start = view.rest_fraction * r if modelled.plays_V is None else np.interp(r, view.play_r_V, modelled.plays_V)
        moved, _ = plays(v, r, np.clip(start + v[0] - view.field.at(signal.u_V[0]), v[0] - r, v[0] + r))
        columns += list(((OPEN_STD if open_plays else PLAY_STD) * slope * view.density.read(moved)).T)
    if view.deadzone_d_V:
        knots = np.linspace(low, high, BASE_SEGMENTS + 2)[1:-1]
        columns += list(PLAY_STD * slope * np.maximum(v[:, None] - knots, 0.0).T)
    return through_effects(modelled, np.stack(columns, axis=1))[1:][modelled.run.rows]


def through_effects(modelled: ModelledRun, columns: Samples) -> Samples:
    """What changes (n + 1, k) of the operator's output, in um, become behind creep, mechanics and sensor."""
    signal = modelled.chain.signal_at(Place.HYSTERESIS)
    behind = [(e, params) for e, params in signal.active if e.place > Place.HYSTERESIS]
    if not behind:
        return columns
    values = np.column_stack([signal.value, signal.value[:, None] + columns])
    for e, params in behind:
        values = _all_through(e, params, signal, values)
    return np.asarray(values[:, 1:] - values[:, :1])


def _all_through(e: Effect, params: Params, signal: Signal, values: Samples) -> Samples:
    """One effect applied to each column of ``values`` (n, k) in place of the signal's own."""
    if e.at_once is not None and e.at_once(params):
        return e.apply(signal.carrying(values, signal.drive_V), params)
    return np.stack([e.apply(signal.carrying(value, signal.drive_V), params) for value in values.T.copy()], axis=1)


def rich_columns(modelled: ModelledRun) -> Samples:
    """Columns (n, k) in um of an operator richer than any base, which tell noise from misfit where no reference
    does."""
    run, view = modelled.run, modelled.axis.time
    assert view is not None
    v, slope = view.field.of(run.u_V), RICH_STD * mean_slope(modelled.axis)
    low, high = float(v.min()), float(v.max())
    r = play_thresholds(high - low, RICH_PLAYS)
    rows = np.arange(run.start, run.stop, dtype=np.uintp)
    moved, _ = plays(v, r, np.clip(view.rest_fraction * r, v[0] - r, v[0] + r), rows)
    knots = np.linspace(low, high, RICH_SEGMENTS + 2)[1:-1]
    bends = np.maximum(v[run.rows, None] - knots, 0.0)
    return np.asarray(slope * np.concatenate([moved, bends], axis=1))


def mean_slope(axis: AxisModel) -> float:
    """Mean slope in um/V over the fitted range, all plays moving; 1 where it is 0. The axis has a time view."""
    view = axis.time
    assert view is not None
    low, high = map(view.field.at, view.u_range_V)
    bends = sum(s * (high - d) / (high - low) for d, s in zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True))
    return float(abs(view.gain_um_per_V + view.density.mean * sum(view.play_w_um_per_V) + bends)) or 1.0
