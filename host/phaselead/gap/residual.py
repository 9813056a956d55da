"""Residuals: measurement against the model driven by the applied voltage, with each record's own offset and memory.

Offset and initial memory say nothing about the model, so every comparison is made after removing what they could
explain: the columns of ``local_columns``, the memory's shrunk to how far a play can stand from where it was put.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from phaselead.gap.noise import period_of
from phaselead.gap.records import Run
from phaselead.identify import AxisRun, Sine
from phaselead.model import AxisModel, Chain, Extra, Place, respond, rest_plays
from phaselead.record import Samples

MEMORY_ROWS = 20_000
OTHER_MEMORY = 0.8
"""A record starts from another memory than rest when that leaves less than this share of its variance."""
PLAY_SPREAD = 0.5
"""Standard deviation of a play's start about its best guess, in thresholds."""


@dataclass(frozen=True)
class Track:
    """A run under one model of its axis: the memory it starts from, and what its own nuisances can explain."""

    run: Run
    axis: AxisModel
    chain: Chain
    plays_V: Samples | None
    """Initial plays (m,); None is rest."""
    local: Samples
    """Columns (n, k) of the nuisances over the scored rows: the offset, then um per standard deviation."""

    @cached_property
    def period_rows(self) -> int | None:
        """Rows after which the drive repeats, or None."""
        if self.sine is not None:
            return round(1 / (self.sine.f_Hz * self.run.step_s))
        return period_of(self.run.u_V[self.run.rows])

    @cached_property
    def sine(self) -> Sine | None:
        """The sine that drives it, still stretches at either end left out, or None."""
        run = self.run
        return AxisRun(run.t_s, run.u_V, run.x_um, run.rows, run.axis, run.source).sine if run.driven else None

    def answer(self, extra: Extra = ()) -> Samples:
        """The model's position over the scored rows, (n,) in um."""
        return self.chain.run(extra)[self.run.rows]

    def with_axis(self, axis: AxisModel) -> Track:
        """The same run from the same memory under another model of its axis."""
        return replace(self, axis=axis, chain=_chain(axis, self.run, self.plays_V))

    def error(self, extra: Extra = ()) -> Samples:
        """Measured minus model over the scored rows, (n,) in um; the record's offset is still in it."""
        return np.asarray(self.run.x_um[self.run.rows] - self.answer(extra))


def track(axis: AxisModel, run: Run) -> Track:
    """The run with the best simple memory: from rest, or from one turning point."""
    assert axis.time is not None
    start = _best_start(axis, run) if axis.time.play_r_V else None
    return Track(run, axis, _chain(axis, run, start), start, local_columns(axis, run, start))


def _chain(axis: AxisModel, run: Run, start: Samples | None) -> Chain:
    others = {name: x - np.median(x[: max(1, len(x) // 100)]) for name, x in run.others_um.items()}
    return Chain(axis, run.t_s, run.u_V, others_um=others, start=start)


def _at_plays(axis: AxisModel, run: Run, start: Samples | None) -> tuple[Samples, float]:
    """Voltage (n,) at the plays, and how far beside the recorded one it stood before the record: on a rail, say."""
    signal = _chain(axis, run, start).signal_at(Place.AMPLIFIER)
    return signal.value[1:], float(signal.value[0] - signal.u_V[0])


def _best_start(axis: AxisModel, run: Run) -> Samples | None:
    view = axis.time
    assert view is not None
    r, rest, u = np.asarray(view.play_r_V), rest_plays(view), run.u_V
    rows = np.arange(run.start, run.stop, max(1, len(u) // MEMORY_ROWS))
    left = (run.x_um - _chain(axis, run, None).run())[rows]
    v, aside_V = _at_plays(axis, run, None)
    at_rest = respond(view, v, rest + aside_V)[0][rows]
    v, aside_V = _at_plays(axis, run, rest)
    best, best_left = None, OTHER_MEMORY * float(np.var(left))
    low, high = min(view.u_range_V[0], float(u.min())), max(view.u_range_V[1], float(u.max()))
    for came_from in np.linspace(low, high, 15):
        start = np.clip(np.clip(rest, came_from - r, came_from + r), u[0] - r, u[0] + r)
        change = respond(view, v, start + aside_V)[0][rows] - at_rest
        variance = float(np.var(left - change))
        if variance < best_left:
            best, best_left = start, variance
    return best


def local_columns(axis: AxisModel, run: Run, plays_V: Samples | None) -> Samples:
    """Offset, and what a shift of each play's start would do: its weight until the play first moves."""
    view = axis.time
    assert view is not None
    n = run.stop - run.start
    columns = [np.ones(n)]
    if view.play_r_V:
        r, w = np.asarray(view.play_r_V), np.asarray(view.play_w_um_per_V)
        v, aside_V = _at_plays(axis, run, plays_V)
        start = aside_V + (rest_plays(view) if plays_V is None else plays_V)
        for j, moved_at in enumerate(_first_moves(v, r, start)):
            still = min(moved_at, run.stop) - run.start
            if 0 < still < n and w[j] > 0:
                column = np.zeros(n)
                column[:still] = w[j] * PLAY_SPREAD * r[j]
                columns.append(column)
    return np.stack(columns, axis=1)


def _first_moves(v: Samples, r: Samples, start: Samples) -> list[int]:
    """The row at which each play first leaves its start."""
    high, low = np.maximum.accumulate(v), np.minimum.accumulate(v)
    up = np.searchsorted(high, start + r, side="right")
    down = np.searchsorted(-low, r - start, side="right")
    return [int(min(a, b)) for a, b in zip(up, down, strict=True)]
