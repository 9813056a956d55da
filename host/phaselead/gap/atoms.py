"""Atoms: what each effect would add to the position, simulated once at a few shapes, one column per size parameter.

Also the columns of the base model itself: what refitting it could absorb.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from phaselead.gap.residual import Track
from phaselead.identify import play_thresholds
from phaselead.model import AxisModel, Effect, Extra, Parameter, Params, Place, Signal, plays
from phaselead.record import Samples

SHAPES = 5
NARROW_RATIO, NARROW_ZETA = 1.16, 0.08
"""A mode is looked for at frequencies in this ratio, with this damping: neighbours then overlap."""
BASE_PLAYS, BASE_SEGMENTS = 10, 8
RICH_PLAYS, RICH_SEGMENTS, RICH_STD = 24, 12, 0.1
GAIN_STD, PLAY_STD, OPEN_STD = 0.05, 0.02, 0.3
"""How far a fitted base can be off where no reference record says better, as shares of its mean slope; OPEN_STD where
its plays are fitted anew with every effect."""


DELAY_STD, OWN_STD = 0.05, 0.005
"""The same of its delay, in rows, and of the parameters of its own effects."""


@dataclass(frozen=True)
class Atom:
    """One effect at one shape. ``steps``: the size at which each column was simulated."""

    effect: Effect
    shapes: Mapping[str, float]
    steps: tuple[float, ...]
    coarse: bool
    """Whether it belongs to the few that describe what the base misses on reference records."""

    def params(self, amounts: Sequence[float]) -> dict[str, float]:
        """Parameters for amounts of each column."""
        sizes = {p.name: a * s for p, a, s in zip(self.effect.sizes, amounts, self.steps, strict=True)}
        return {**self.shapes, **sizes}

    def columns(self, track: Track, base_um: Samples, extra: Extra = ()) -> Samples:
        """(n, sizes) in um over the scored rows, per step, beside the effects ``extra`` that ``base_um`` has."""
        found = []
        for i in range(len(self.steps)):
            amounts = [float(i == j) for j in range(len(self.steps))]
            found.append(track.answer([*extra, (self.effect, self.params(amounts))]) - base_um)
        return np.stack(found, axis=1)


def atoms_of(effects: Sequence[Effect], step_s: float, longest_s: float) -> list[Atom]:
    """Atoms of every effect, shapes limited to what records of this step and length can show."""
    found = []
    for effect in effects:
        grids = [_grid(p, effect, step_s, longest_s) for p in effect.shapes]
        steps = tuple(p.typical if p.typical else p.high for p in effect.sizes)
        points = list(product(*grids))
        coarse = set(points[:: max(1, round(len(points) / 6))])
        for point in points:
            shapes = {p.name: v for p, v in zip(effect.shapes, point, strict=True)}
            if _ordered(shapes):
                common = point in coarse and effect.kind == "response"
                found.append(Atom(effect, shapes, steps, common))
    return found


def _grid(p: Parameter, effect: Effect, step_s: float, longest_s: float) -> list[float]:
    low, high = p.low, p.high
    narrow = any(other.name == "zeta" for other in effect.shapes)
    if p.unit == "Hz":
        high = min(high, 0.45 / step_s)
        low = min(max(low, 1 / longest_s), high)
    if p.unit == "s":
        low, high = max(low, 0.5 * step_s), min(high, 30 * longest_s)
        high = max(low, high)
    if p.name == "zeta":
        return [NARROW_ZETA]
    if narrow and p.unit == "Hz":
        count = max(2, int(np.log(high / low) / np.log(NARROW_RATIO)))
        return [float(v) for v in np.geomspace(low, high, count)]
    if len(effect.shapes) > 1 and p is not effect.shapes[0]:
        return [float(np.clip(p.typical, low, high))]
    if p.log:
        return [float(v) for v in np.geomspace(low, high, SHAPES)]
    return [float(v) for v in np.linspace(low, high, SHAPES)]


def _ordered(shapes: Mapping[str, float]) -> bool:
    """A first time constant lies before a last one."""
    first = [v for name, v in shapes.items() if "first" in name]
    last = [v for name, v in shapes.items() if "last" in name]
    return not (first and last) or first[0] < last[0]


@dataclass(frozen=True)
class Freedom:
    """What may be wrong with a base. ``open_plays``: its plays were fitted to these very records and move with every
    effect that is added. ``learned``: reference records say what it misses, so that more may be asked of them."""

    open_plays: bool = False
    learned: bool = False


def base_columns(track: Track, freedom: Freedom, extra: Extra = ()) -> Samples:
    """(n, k): one standard deviation of each thing a refit of the base could change, seen through the effects around
    it. A base without plays has no plays to refit, one without dead zones no dead zones."""
    view = track.axis.time
    assert view is not None
    signal = track.chain.signal_at(Place.AMPLIFIER, extra)
    v = signal.value
    slope = mean_slope(track.axis)
    low, high = view.u_range_V
    columns = [GAIN_STD * slope * v]
    if view.play_r_V:
        r = play_thresholds(high - low, BASE_PLAYS)
        start = view.rest_fraction * r if track.plays_V is None else np.interp(r, view.play_r_V, track.plays_V)
        moved, _ = plays(v, r, np.clip(start + v[0] - signal.u_V[0], v[0] - r, v[0] + r))
        columns += list(((OPEN_STD if freedom.open_plays else PLAY_STD) * slope * moved).T)
        if freedom.learned:
            columns += _bent(moved, low, high, PLAY_STD * slope)
    if view.deadzone_d_V:
        knots = np.linspace(low, high, BASE_SEGMENTS + 2)[1:-1]
        columns += list(PLAY_STD * slope * np.maximum(v[:, None] - knots, 0.0).T)
    refitted = through_effects(track, np.stack(columns, axis=1), extra)[1:][track.run.rows]
    return np.concatenate([refitted, _own_tangents(track, extra)], axis=1) if freedom.learned else refitted


def _bent(moved: Samples, low: float, high: float, std: float) -> list[Samples]:
    """What plays (n, m) miss of a memory whose density varies over the range (Preisach): their squares and cubes."""
    half = (high - low) / 2
    z = (moved - (low + high) / 2) / half
    return [std * half * column for column in np.concatenate([z**2, z**2 * z], axis=1).T]


def _own_tangents(track: Track, extra: Extra) -> Samples:
    """(n, k) in um: one standard deviation of the base's delay, and of each parameter of its own effects."""
    answer = track.answer(extra)
    return np.stack([track.with_axis(axis).answer(extra) - answer for axis in _nearby(track)], axis=1)


def _nearby(track: Track) -> list[AxisModel]:
    """The base with one of its parameters moved."""
    axis, view = track.axis, track.axis.time
    assert view is not None
    later = view.model_copy(update={"delay_s": view.delay_s + DELAY_STD * track.run.step_s})
    found = [axis.model_copy(update={"time": later})]
    for i, adopted in enumerate(axis.effects):
        for params in _moved_a_little(adopted.params):
            moved = adopted.model_copy(update={"params": params})
            effects = (*axis.effects[:i], moved, *axis.effects[i + 1 :])
            found.append(axis.model_copy(update={"effects": effects}))
    return found


def _moved_a_little(params: Mapping[str, object]) -> list[dict[str, object]]:
    """Every number of ``params``, the lists' too, moved by itself."""
    found: list[dict[str, object]] = []
    for name, value in params.items():
        numbers = value if isinstance(value, tuple) else (value,)
        for i, number in enumerate(numbers):
            if isinstance(number, float):
                changed = (*numbers[:i], number * (1 + OWN_STD), *numbers[i + 1 :])
                found.append({**params, name: changed if isinstance(value, tuple) else changed[0]})
    return found


def through_effects(track: Track, columns: Samples, extra: Extra) -> Samples:
    """What changes (n + 1, k) of the operator's output become behind creep, mechanics and sensor."""
    signal = track.chain.signal_at(Place.HYSTERESIS, extra)
    behind = [(e, params) for e, params in signal.active if e.place > Place.HYSTERESIS]
    if not behind:
        return columns
    values = np.column_stack([signal.value, signal.value[:, None] + columns])
    for e, params in behind:
        values = _all_through(e, params, signal, values)
    return np.asarray(values[:, 1:] - values[:, :1])


def _all_through(e: Effect, params: Params, signal: Signal, values: Samples) -> Samples:
    """One effect applied to each column of ``values`` (n, k) in place of the signal's; modes take all at once."""
    if e.name == "resonance" and "velocity" not in params:
        return e.apply(signal.carrying(values, signal.drive_V), params)
    return np.stack([e.apply(signal.carrying(value, signal.drive_V), params) for value in values.T.copy()], axis=1)


def rich_columns(track: Track) -> Samples:
    """(n, k): a richer operator than any base, for telling noise from misfit where no reference record does."""
    run, view = track.run, track.axis.time
    assert view is not None
    v, slope = run.u_V, RICH_STD * mean_slope(track.axis)
    low, high = float(v.min()), float(v.max())
    r = play_thresholds(high - low, RICH_PLAYS)
    rows = np.arange(run.start, run.stop, dtype=np.uintp)
    moved, _ = plays(v, r, np.clip(view.rest_fraction * r, v[0] - r, v[0] + r), rows)
    knots = np.linspace(low, high, RICH_SEGMENTS + 2)[1:-1]
    bends = np.maximum(v[run.rows, None] - knots, 0.0)
    return np.asarray(slope * np.concatenate([moved, bends], axis=1))


def mean_slope(axis: AxisModel) -> float:
    """um/V over the fitted range, all plays moving."""
    view = axis.time
    assert view is not None
    low, high = view.u_range_V
    bends = sum(s * (high - d) / (high - low) for d, s in zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True))
    return float(abs(view.gain_um_per_V + sum(view.play_w_um_per_V) + bends)) or 1.0


__all__ = ["Atom", "atoms_of", "base_columns", "mean_slope"]
