"""What a refit of the base could change: its gain, its plays and its bends, and the same beyond the voltages that it
was fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.gap.regressors import mean_slope
from phaselead.gap.residual import ModelledRun
from phaselead.identify import play_thresholds
from phaselead.model import Effect, Extra, Params, Place, Signal, TimeView, plays, plays_after
from phaselead.record import Samples

BASE_PLAYS, BASE_SEGMENTS = 10, 8
"""How finely a refit of the base's operator is described."""
GAIN_STD, PLAY_STD = 0.05, 0.02
"""How far gain and plays of a fitted base can be off where no reference record says better, of its mean slope."""
OPEN_STD = 0.3
"""The same of plays that are fitted anew with every effect."""


def base_columns(modelled: ModelledRun, open_plays: bool) -> Samples:
    """Columns (n, k) in um: one prior deviation of each thing that a refit of the base could change, as it looks behind
    the base's own effects. A base without plays has no plays to refit, one without dead zones no dead zones.

    ``open_plays``: they were fitted to the training records themselves, and move with every effect that is added.
    """
    field = _Field.of(modelled)
    view, slope = field.view, mean_slope(modelled.axis)
    columns = [GAIN_STD * slope * field.v]
    if view.play_r_V:
        r = play_thresholds(field.high - field.low, BASE_PLAYS)
        columns += list(((OPEN_STD if open_plays else PLAY_STD) * slope * field.moved(r)).T)
    if view.deadzone_d_V:
        knots = np.linspace(field.low, field.high, BASE_SEGMENTS + 2)[1:-1]
        columns += list(PLAY_STD * slope * np.maximum(field.v[:, None] - knots, 0.0).T)
    return through_effects(modelled, np.stack(columns, axis=1))[1:][modelled.run.rows]


def reach_V(runs: Sequence[tuple[ModelledRun, Extra]]) -> tuple[float, float]:
    """Lowest and highest field in V that the plays answer to in any run, each with what acts in it."""
    fields = [_Field.of(modelled, acting).v for modelled, acting in runs]
    return min(float(v.min()) for v in fields), max(float(v.max()) for v in fields)


def columns_beyond(modelled: ModelledRun, reach: tuple[float, float], acting: Extra = ()) -> Samples:
    """Columns (n, k) in um of what the base may miss beyond the voltages that it was fitted to, one prior deviation
    each, as it looks beside ``acting`` effects: plays and bends go on there as far off as within, and the slope may go
    on changing as it does within on the average, where the model goes straight on. ``reach``: how far any record goes;
    k is the same for all of them, and 0 where none goes beyond."""
    field = _Field.of(modelled, acting)
    slope, columns = PLAY_STD * mean_slope(modelled.axis), [np.zeros((len(field.v), 0))]
    if field.view.play_r_V:
        columns.append(slope * field.moved(_larger_thresholds(field, reach)))
    segment = (field.high - field.low) / (BASE_SEGMENTS + 1)
    ends = (field.v - field.high, reach[1] - field.high), (field.low - field.v, field.low - reach[0])
    if field.bends_um_per_V2 and max(most for _, most in ends) > 0:
        square_V2 = np.sum([np.maximum(past, 0.0) ** 2 for past, _ in ends], axis=0)
        columns.append(field.bends_um_per_V2 / 2 * square_V2[:, None])
    for past, most in ends:
        count = min(int(np.ceil(max(most, 0.0) / segment)), BASE_SEGMENTS)
        each = max(most, 0.0) / max(count, 1)
        # The slope changes as much from one segment to the next, however long they are.
        columns.append(slope * np.sqrt(each / segment) * np.maximum(past[:, None] - each * np.arange(count), 0.0))
    return through_effects(modelled, np.concatenate(columns, axis=1), acting)[1:][modelled.run.rows]


def _larger_thresholds(field: _Field, reach: tuple[float, float]) -> Samples:
    """Thresholds (m,) in V of the plays of a refit that only records beyond the fitted field move, as many at most as
    move within it."""
    further = (reach[1] - reach[0]) / (field.high - field.low)
    count = int(np.clip(BASE_PLAYS * further ** (2 / 3), BASE_PLAYS, 2 * BASE_PLAYS))
    every = play_thresholds((field.high - field.low) * (count / BASE_PLAYS) ** 1.5, count)
    return every[BASE_PLAYS:]


@dataclass(frozen=True)
class _Field:
    """The field that the plays of a run answer to."""

    modelled: ModelledRun
    view: TimeView
    v: Samples
    """(n + 1,) in V, the row in front of the record first."""
    before_V: float
    """Voltage in that row."""
    low: float
    high: float
    """Of what the base was fitted to, in V."""

    @property
    def bends_um_per_V2(self) -> float:
        """By how much the slope of the base's bends changes per volt of what it was fitted to, on the average."""
        bends = zip(self.view.deadzone_d_V, self.view.deadzone_s_um_per_V, strict=True)
        return float(sum(s if d >= 0 else -s for d, s in bends) / (self.high - self.low))

    @classmethod
    def of(cls, modelled: ModelledRun, acting: Extra = ()) -> _Field:
        """Beside ``acting`` effects."""
        view = modelled.axis.time
        assert view is not None
        signal = modelled.chain.signal_at(Place.AMPLIFIER, acting)
        low, high = map(view.field.at, view.u_range_V)
        return cls(modelled, view, view.field.of(signal.value), float(signal.u_V[0]), low, high)

    def moved(self, r_V: Samples) -> Samples:
        """What plays of thresholds (m,) in V add, (n + 1, m), a unit of weight each."""
        began = self.modelled.began
        way_V = () if began is None else (*began.turned_V, self.before_V)
        start = plays_after(self.view, *way_V, r_V=r_V) + self.v[0] - self.view.field.at(self.before_V)
        return self.view.density.read(plays(self.v, r_V, np.clip(start, self.v[0] - r_V, self.v[0] + r_V))[0])


def through_effects(modelled: ModelledRun, columns: Samples, acting: Extra = ()) -> Samples:
    """What changes (n + 1, k) of the operator's output, in um, become behind creep, mechanics and sensor, and behind
    ``acting`` effects."""
    signal = modelled.chain.signal_at(Place.HYSTERESIS, acting)
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
