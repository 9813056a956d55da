"""Residuals: measurement minus the model driven by the applied voltage, with each record's own offset and memory.

Offset and starting memory say nothing about the model. They are nuisances: their columns (``nuisances``) are projected
out of everything that is compared, the memory's shrunk to how far a play can stand from where it was put.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from phaselead.errors import BadInput
from phaselead.gap.records import GapRun, complete_axes, run_of
from phaselead.identify import Turns, starting_memory, way_before
from phaselead.model import (
    AdoptedEffect,
    AxisModel,
    Chain,
    Entry,
    Extra,
    Mode,
    Place,
    Stage,
    TimeView,
    effect,
    modes_in,
    plays,
    plays_after,
    rest_plays,
    rewritten,
)
from phaselead.record import Recording, Samples

MEMORY_ROWS = 4000
"""Most rows of a record on which starting memories are compared; of longer ones some are left out."""
TURNING_POINTS = 15
"""How many voltages at which it may have turned are tried, from the lowest to the highest of model and record."""
PLAY_SPREAD = 0.5
"""Standard deviation of a play's start about its best guess, in thresholds: its prior as a nuisance."""
FADING_MEMORY = 0.25
"""Of the variance of a record: what another start than rest of fading plays leaves at most. It fades over the whole
record, as what is missing from the model may do in part; a start that is the truth leaves little more than the base
does."""
ALIKE = 1e-9
"""Relative difference of variances by which rounding alone differs."""
PERIODIC = 0.98
"""Correlation with itself a period later from which a voltage counts as periodic."""


Index = NDArray[np.intp]
"""Rows, (k,)."""


class Began(NamedTuple):
    """The memory of a record that does not begin with a step from rest: it stood at its first voltage."""

    plays_V: Samples
    """(m,) where the plays stand in its first row."""
    turned_V: Turns
    """Where the voltage turned round before it."""


@dataclass(frozen=True)
class ModelledRun:
    """A run under one model of its axis: the chain that simulates it, and the memory it starts from."""

    run: GapRun
    axis: AxisModel
    chain: Chain
    began: Began | None
    """None is a step from rest at 0 V in the first row."""

    @cached_property
    def period_rows(self) -> int | None:
        """Rows after which its voltage repeats; None where it does not."""
        if self.run.sine is not None:
            return round(1 / (self.run.sine.f_Hz * self.run.step_s))
        return period_of(self.run.u_V[self.run.rows])

    def answer(self, extra: Extra = ()) -> Samples:
        """Position (n,) in um over the scored rows, of the model with the effects ``extra``."""
        return self.chain.run(extra)[self.run.rows]

    def error(self, extra: Extra = ()) -> Samples:
        """Residual (n,) in um over the scored rows: measured minus the model with the effects ``extra``. The record's
        offset is still in it."""
        return np.asarray(self.run.x_um[self.run.rows] - self.answer(extra))

    def error_about_mean(self, extra: Extra = ()) -> Samples:
        """The same without its mean, which is the record's own offset."""
        error = self.error(extra)
        return np.asarray(error - error.mean())

    @cached_property
    def nuisances(self) -> Samples:
        """Columns (n, k) over the scored rows that the record's own offset and memory explain: a constant, then in um
        what a prior deviation of each play's start would do, its weight until the play first moves, and what the
        effects of the base still do that remember another way before the record."""
        view, run = self.axis.time, self.run
        assert view is not None
        n = run.stop - run.start
        columns = [np.ones(n)]
        if view.play_r_V:
            v, offset_V = _at_plays(self.chain, view)
            start = offset_V + (rest_plays(view) if self.began is None else self.began.plays_V)
            r, w = np.asarray(view.play_r_V), np.asarray(view.play_w_um_per_V) * view.density.at(start)
            for j, moved_at in enumerate(_first_moves(v, r, start)):
                still = min(moved_at, run.stop) - run.start
                if 0 < still < n and w[j] != 0:
                    column = np.zeros(n)
                    column[:still] = w[j] * PLAY_SPREAD * r[j]
                    columns.append(column)
        for e, params in _remembering(self.axis):
            assert e.began_with is not None
            still_does = e.began_with(self.chain.signal_at(Place.HYSTERESIS), params)[1:][run.rows]
            columns += [PLAY_SPREAD * column for column in still_does.T]
        return np.stack(columns, axis=1)


def modelled_run(axis: AxisModel, run: GapRun, beside: Extra = ()) -> ModelledRun:
    """The run under the model of its axis, which has a time view, from the best simple memory: from rest, or after up
    to four turns. A stage at rest may have been switched to the first voltage in the first row, or have stood there for
    long: whichever leaves less of the record.

    ``beside``: effects that ``answer`` and ``error`` will be given. The memory is looked for with them, since what they
    do might be taken for another one."""
    assert axis.time is not None
    return _modelled_from(_best_start(with_effects(axis, beside), run), axis, run)


def run_from_rest(axis: AxisModel, run: GapRun) -> ModelledRun:
    """The run under the model of its axis after a step from rest in its first row, whatever was measured."""
    return _modelled_from(None, axis, run)


def run_from_where_it_stood(axis: AxisModel, run: GapRun) -> ModelledRun:
    """The run under the model of its axis after it had stood at its first voltage, straight from rest."""
    assert axis.time is not None
    return _modelled_from(Began(plays_after(axis.time, float(run.u_V[0])), ()), axis, run)


def _modelled_from(began: Began | None, axis: AxisModel, run: GapRun) -> ModelledRun:
    return ModelledRun(run, axis, _chain(axis, run, began), began)


def with_effects(axis: AxisModel, entries: Extra) -> AxisModel:
    """The axis with more effects of its own."""
    more = [AdoptedEffect(name=effect.name, params=dict(params)) for effect, params in entries]
    return axis.model_copy(update={"effects": (*axis.effects, *more)}) if more else axis


def left_um(stage: Stage, records: Sequence[Recording]) -> float:
    """RMS in um that a model leaves of records, axis by axis, each about its own offset and from the memory that suits
    it best: the gap before, were these held out. Raises BadInput where no record has an axis with a time view."""
    known = [axis for axis, model in stage.axes.items() if model.time is not None]
    runs = [run_of(record, axis, "holdout") for record in records for axis in complete_axes(record) if axis in known]
    if not runs:
        raise BadInput(
            f"no record has an axis of which stage {stage.name!r} has a time view; fit it to recordings first"
        )
    errors = [modelled_run(stage.axes[run.axis], run).error_about_mean() for run in runs]
    return float(np.sqrt(power_um2(errors)))


def _chain(axis: AxisModel, run: GapRun, began: Began | None) -> Chain:
    others = {name: x - np.median(x[: max(1, len(x) // 100)]) for name, x in run.others_um.items()}
    plays_V, turned_V = (None, None) if began is None else began
    return Chain(axis, run.t_s, run.u_V, others_um=others, start=plays_V, turned_V=turned_V)


def _at_plays(chain: Chain, view: TimeView) -> tuple[Samples, float]:
    """Field (n,) in V that the plays answer to, and by how much it stood off that of the recorded voltage before the
    record: on a rail, say."""
    signal = chain.signal_at(Place.AMPLIFIER)
    v = view.field.of(signal.value)
    return v[1:], float(v[0]) - view.field.at(float(signal.u_V[0]))


def _best_start(axis: AxisModel, run: GapRun) -> Began | None:
    """The memory at the start of the record, from the best way that the stage may have come; None is a step from
    rest."""
    view, u = axis.time, run.u_V
    assert view is not None
    rows = np.arange(run.start, run.stop, max(1, len(u) // MEMORY_ROWS))
    first_V = float(u[0])

    def began(turned_V: Turns) -> Began:
        return Began(plays_after(view, *turned_V, first_V), turned_V)

    def left(start: Began | None) -> Samples:
        return np.asarray((run.x_um - _chain(axis, run, start).run())[rows])

    stood = began(())
    stood_left, stepped_variance = left(stood), float(np.var(left(None)))
    stood_variance = float(np.var(stood_left))
    # A base without dynamics answers both alike; what is tried beside it then begins where the stage was.
    at_rest = None if stepped_variance < (1 - ALIKE) * stood_variance else stood
    if not view.play_r_V:
        return at_rest
    operator_um = _fading_um if _remembering(axis) else _plays_um
    of_start = operator_um(axis, run, stood, rows)
    stood_um = of_start(stood)

    def variance(turned_V: Turns | None) -> float:
        if not turned_V:
            return min(stood_variance, stepped_variance)
        return float(np.var(stood_left - (of_start(began(turned_V)) - stood_um)))

    low, high = min(view.u_range_V[0], float(u.min())), max(view.u_range_V[1], float(u.max()))
    points = np.linspace(low, high, TURNING_POINTS).tolist()
    if _remembering(axis):
        turned_V = starting_memory(variance, points, FADING_MEMORY)
    else:
        turned_V = way_before(cache(variance), points, first_V)
    return began(turned_V) if turned_V else at_rest


def _plays_um(axis: AxisModel, run: GapRun, stood: Began, rows: Index) -> Callable[[Began], Samples]:
    """Answer (rows,) in um of the plays of the time view from any start in which the stage stood at its first voltage,
    but for what does not depend on it.

    Each row of a voltage takes a play into v - r to v + r, and so do all of them together into some other interval,
    which is found from a start far below and one far above.
    """
    view = axis.time
    assert view is not None
    v, offset_V = _at_plays(_chain(axis, run, stood), view)
    r, w = np.asarray(view.play_r_V), np.asarray(view.play_w_um_per_V)
    at, far_V = rows.astype(np.uintp), np.ptp(v) + abs(v).max() + 2 * r
    # What is read of a play rises with it: it may be read before as well as after it is held within that interval.
    low, high = (view.density.read(plays(v, r, start, at)[0]) for start in (-far_V, far_V))
    return lambda began: np.clip(view.density.read(offset_V + began.plays_V), low, high) @ w


def _fading_um(axis: AxisModel, run: GapRun, stood: Began, rows: Index) -> Callable[[Began], Samples]:
    """Answer (rows,) in um of the plays and of the base's effects that remember where they turned."""
    return lambda began: _chain(axis, run, began).signal_at(Place.HYSTERESIS).value[1:][rows]


def _remembering(axis: AxisModel) -> list[Entry]:
    """The base's own effects that remember where they turned."""
    return [(e, e.complete(params)) for e, params in base_entries(axis) if e.began_with is not None]


def _first_moves(v: Samples, r: Samples, start: Samples) -> list[int]:
    """Row at which each of m plays of thresholds ``r`` and positions ``start`` (m,) first moves under a voltage
    (n,)."""
    high, low = np.maximum.accumulate(v), np.minimum.accumulate(v)
    up = np.searchsorted(high, start + r, side="right")
    down = np.searchsorted(-low, r - start, side="right")
    return [int(min(a, b)) for a, b in zip(up, down, strict=True)]


def period_of(u_V: Samples) -> int | None:
    """Rows after which a voltage (n,) repeats: the first strong peak of its autocorrelation; None without one."""
    n = len(u_V)
    u = u_V - u_V.mean()
    power = float(np.mean(u**2))
    if not power > 0:
        return None
    spectrum = np.abs(np.fft.rfft(u, 2 * n)) ** 2
    rho = np.fft.irfft(spectrum)[: n // 2 + 1] / np.arange(n, n - n // 2 - 1, -1) / power
    below = np.flatnonzero(rho < 0.5)
    if not len(below):
        return None
    strong = np.flatnonzero(rho[below[0] :] > PERIODIC)
    if not len(strong):
        return None
    first = int(below[0] + strong[0])
    last = first + int(np.argmax(rho[first : first + max(2, first // 8)]))
    return last if float(np.mean((u[last:] - u[:-last]) ** 2)) < (1 - PERIODIC) * power else None


def power_um2(errors: Sequence[Samples]) -> float:
    """Mean square over all rows of some residuals (n_i,)."""
    return float(np.mean(np.concatenate(errors) ** 2))


def base_entries(axis: AxisModel) -> list[Entry]:
    """The effects that a model of an axis has, with their parameters."""
    return [(effect(one.name), one.params) for one in axis.effects]


def base_modes(axis: AxisModel) -> list[Mode]:
    """The modes of the mechanics that a model of an axis has, as its other effects change them."""
    return modes_in(rewritten([(one, one.complete(params)) for one, params in base_entries(axis)]))


@dataclass(frozen=True)
class RunResidual:
    """The residual of one run under one model, about its own mean."""

    run: GapRun
    error_um: Samples
    """(n,) over the scored rows."""

    @property
    def rate_Hz(self) -> float:
        """Sampling rate."""
        return 1 / self.run.step_s

    @cached_property
    def speed_um_per_s(self) -> Samples:
        """Speed (n,) of the model, which is free of noise, from a cubic spline through its positions."""
        t_s = np.arange(len(self.error_um)) * self.run.step_s
        return np.asarray(CubicSpline(t_s, self.run.x_um[self.run.rows] - self.error_um)(t_s, 1))
