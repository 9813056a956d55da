"""What a refit of the base could change: its gain, its plays and its bends, and the same beyond the voltages that it
was fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.gap.residual import ModelledRun
from phaselead.identify import play_thresholds
from phaselead.model import AxisModel, Effect, Extra, Params, Place, Signal, TimeView, plays, plays_after
from phaselead.record import Samples

BASE_PLAYS, BASE_SEGMENTS = 10, 8
"""How finely a refit of the base's operator is described."""
GAIN_STD, PLAY_STD = 0.05, 0.02
"""How far gain and plays of a fitted base can be off where no reference record says better, of its mean slope."""
OPEN_STD = 0.3
"""The same of plays that are fitted anew with every effect."""


def mean_slope(axis: AxisModel) -> float:
    """Mean slope in um/V over the fitted range, all plays moving; 1 where it is 0. The axis has a time view."""
    view = axis.time
    assert view is not None
    low, high = map(view.field.at, view.u_range_V)
    bends = sum(s * (high - d) / (high - low) for d, s in zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True))
    return float(abs(view.gain_um_per_V + view.density.mean * sum(view.play_w_um_per_V) + bends)) or 1.0


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


def span_of_fields(runs: Sequence[tuple[ModelledRun, Extra]]) -> tuple[float, float]:
    """Lowest and highest field in V that the plays answer to in any run, each with what acts in it."""
    fields = [_Field.of(modelled, acting).v for modelled, acting in runs]
    return min(float(v.min()) for v in fields), max(float(v.max()) for v in fields)


def columns_beyond(modelled: ModelledRun, span: tuple[float, float], acting: Extra = ()) -> Samples:
    """Columns (n, k) in um of what the base may miss beyond the voltages that it was fitted to, one prior deviation
    each, as it looks beside ``acting`` effects.

    Plays and bends go on there, as far off as those that a fit has within; a model without bends may have some there.
    Its slope, which goes straight on, may as well go on changing as it does within. ``span``: lowest and highest field
    in V of all records; k is the same for each of them, and 0 where none goes beyond.
    """
    field = _Field.of(modelled, acting)
    below, above = max(field.low - span[0], 0.0), max(span[1] - field.high, 0.0)
    columns = [np.zeros((len(field.v), 0))]
    if below or above:
        off = PLAY_STD * mean_slope(modelled.axis)
        columns = [
            field.slope_goes_on_um()[:, None],
            off * field.moved_beyond(_larger_thresholds(field, span)),
            off * _bends(field.v - field.high, above, field.segment),
            off * _bends(field.low - field.v, below, field.segment),
        ]
    return through_effects(modelled, np.concatenate(columns, axis=1), acting)[1:][modelled.run.rows]


def _bends(past: Samples, farthest: float, segment: float) -> Samples:
    """Columns (n, m) in V of a slope that changes by one at the end of the fitted field and then segment by segment,
    ``past`` (n,) V beyond that end; longer segments where more than usual would reach the farthest. The change grows
    with the root of the length, as that of a random walk does."""
    count = min(int(np.ceil(farthest / segment)), BASE_SEGMENTS)
    length = farthest / max(count, 1)
    return np.asarray(np.sqrt(length / segment) * np.maximum(past[:, None] - length * np.arange(count), 0.0))


def _larger_thresholds(field: _Field, span: tuple[float, float]) -> Samples:
    """Thresholds (m,) in V of the plays of a refit that only records beyond the fitted field move, as many at most as
    move within it; none of a base without plays."""
    if not field.view.play_r_V:
        return np.zeros(0)
    wider = (max(span[1], field.high) - min(span[0], field.low)) / (field.high - field.low)
    count = min(int(BASE_PLAYS * wider ** (2 / 3)), 2 * BASE_PLAYS)
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
    """Ends of the field in V that the base was fitted to."""

    @property
    def segment(self) -> float:
        """Length in V of a segment of a refit."""
        return (self.high - self.low) / (BASE_SEGMENTS + 1)

    def slope_goes_on_um(self) -> Samples:
        """(n + 1,) in um: what is added beyond the fitted voltages where the slope of the base, all plays moving, goes
        on changing there as it does from the first segment within to the last."""
        low_V, high_V = self.view.u_range_V
        first, last = (self._slope_um_per_V(at_V) for at_V in (low_V, high_V))
        changes = (last - first) / ((high_V - low_V) * BASE_SEGMENTS / (BASE_SEGMENTS + 1))
        above_V = np.maximum(self.v - self.high, 0.0) / (self.view.field.at(high_V + 1) - self.high)
        below_V = np.maximum(self.low - self.v, 0.0) / (self.low - self.view.field.at(low_V - 1))
        return np.asarray(changes / 2 * (above_V**2 + below_V**2))

    def _slope_um_per_V(self, end_V: float) -> float:
        """Of the base over the segment at one end of the fitted voltages, all plays moving."""
        low_V, high_V = self.view.u_range_V
        within = (high_V - low_V) / (BASE_SEGMENTS + 1) * (1 if end_V == low_V else -1)  # V, towards the other end
        v = self.view.field.of(np.array([end_V, end_V + within]))
        x = self.view.gain_um_per_V * v + sum(self.view.play_w_um_per_V) * self.view.density.read(v)
        for d_V, s_um_per_V in zip(self.view.deadzone_d_V, self.view.deadzone_s_um_per_V, strict=True):
            x = x + s_um_per_V * np.maximum(v - d_V, 0.0)
        return float((x[1] - x[0]) / within)

    @classmethod
    def of(cls, modelled: ModelledRun, acting: Extra = ()) -> _Field:
        """Beside ``acting`` effects."""
        view = modelled.axis.time
        assert view is not None
        signal = modelled.chain.signal_at(Place.AMPLIFIER, acting)
        low, high = map(view.field.at, view.u_range_V)
        return cls(modelled, view, view.field.of(signal.value), float(signal.u_V[0]), low, high)

    def moved(self, r_V: Samples) -> Samples:
        """What plays of thresholds (m,) in V add, (n + 1, m) in V, a unit of weight each."""
        return self._moved_by(self.v, r_V)

    def moved_beyond(self, r_V: Samples) -> Samples:
        """The same, less what a field that stops at both ends of the fitted one moves of it."""
        return self._moved_by(self.v, r_V) - self._moved_by(np.clip(self.v, self.low, self.high), r_V)

    def _moved_by(self, v: Samples, r_V: Samples) -> Samples:
        began = self.modelled.began
        way_V = () if began is None else (*began.turned_V, self.before_V)
        start = plays_after(self.view, *way_V, r_V=r_V) + self.v[0] - self.view.field.at(self.before_V)
        return self.view.density.read(plays(v, r_V, np.clip(start, v[0] - r_V, v[0] + r_V))[0])


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
