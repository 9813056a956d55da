"""The operator of one axis and the first modes of its mechanics, fitted together.

Where the fit starts: from the modes that the measured response shows where the records are broadband; else from ringing
after every kink, in what the operator alone leaves of fast records. Of the latter a mode is adopted only when it pays
where it was not fitted, and at most two are looked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from phaselead.identify.modal.shown_modes import measured_response, modes_shown
from phaselead.identify.operator import OperatorFit, Turns, fit_linear, fit_operator, place_operator
from phaselead.identify.runs import STILL_V, AxisRun
from phaselead.model import (
    AdoptedEffect,
    AxisModel,
    Entry,
    Mode,
    TimeView,
    effect_of_modes,
    mode_coefficients,
    plays_after,
    resonant,
    second_order_residual,
    simulate,
)
from phaselead.record import Samples

SLOWEST_RATE_HZ = 400.0
LOWEST_HZ, FIRST_OF_RATE, SECOND_OF_RATE = 30.0, 0.9, 0.45
"""Range searched: a ringing slower than this is creep or drift to us. A mode beyond half of the rate is not seen to
ring, but it raises the response below it, by (f/f_Hz)^2; a second one, of less weight, is to be seen."""
APART = 1.3
"""A second mode lies this factor above the first at least: below it, it would stand in for what the operator misses."""
TRIED_FREQUENCIES, TRIED_ZETAS = 100, (0.01, 0.03, 0.1)
TRIED_ON_RUNS = 4
"""The grid is tried on so many runs, the shortest."""
ZETA, UNDAMPED = (0.002, 0.5), 0.0022
"""Range of damping; a second mode at its lower bound stands in for what the delay leaves."""
MOST_SHARE = 0.1
"""Of the motion: a second mode that carries more stands in for what happens between rows."""
MOST_RUNS = 16
FEW_RUNS, ALTERNATING_BLOCKS = 8, 24
"""Below so many runs each is fitted and judged on alternating blocks of itself, not on alternating runs, and fitted by
its second differences: what the operator misses of the slow way would outweigh the ringing."""
SPECTRUM_ROWS, PEAK_WIDTH = 4096, 8
PEAKS = 4
"""Of the residual's spectrum, tried beside the grid: a lightly damped mode is narrower than the grid's steps."""
PAYS, SECOND_PAYS = 0.9, 0.95
"""Adopted when it leaves less than this share of the squared residual where it was not fitted; a second one, of its
second differences."""
OUTSIDE_COST = 1e30
"""Cost beyond the range."""
PRECISE = 1e-4
"""Of the squared residual: what a search may leave on the table."""
FIRST_REACH, SECOND_REACH, ZETA_REACH = 0.03, 0.01, 0.4
"""First relative steps of a frequency, with one mode and with two, and of a damping."""
MANY_RUNS = 8
"""A grid of levels and frequencies, which tells thresholds and mode apart by itself."""

ROUNDING = 1e-9
"""Of the range: what is left of a record that the operator follows to the last digit."""

Place = tuple[float, ...]
"""f_Hz and zeta of one mode, or of two in turn."""


@dataclass(frozen=True)
class FittedModes:
    """Modes whose shares of the motion add up to 1, and the delay that goes with them (modes lag too)."""

    modes: tuple[Mode, ...]
    delay_s: float
    share_left: float
    """Of the operator's squared residual, on rows they were not fitted on."""

    def adopted(self, view: TimeView) -> tuple[TimeView, AdoptedEffect]:
        """The time view with the delay that remains, and the entry for the stage file."""
        effect, params = effect_of_modes(self.modes)
        adopted = AdoptedEffect(name=effect.name, params=params, share=min(max(1 - self.share_left, 0.0), 1.0))
        return view.model_copy(update={"delay_s": self.delay_s}), adopted


def fit_together(runs: Sequence[AxisRun]) -> tuple[OperatorFit, FittedModes | None]:
    """The operator of an axis and its first modes, if it shows any. Raises BadInput as ``fit_operator`` does.

    The fit starts from the modes that the measured response shows; where the records have no such band, from those that
    ring in what the operator alone leaves. Of a grid the thresholds are placed in the end.
    """
    shown = modes_shown(measured_response(runs))
    alone = fit_operator(runs, lag_s=shown.lag_s)
    found = _believed(alone, fit_operator(runs, shown.modes, shown.lag_s), runs) if shown.modes else None
    if len(runs) >= MANY_RUNS:
        operator, modes = found or (alone, _ringing_in(alone, runs))
        return _placed(alone, operator, modes, runs)
    return found or _behind_ringing(alone, shown.lag_s, runs)


def _ringing_in(alone: OperatorFit, runs: Sequence[AxisRun]) -> FittedModes | None:
    """The modes that ring in what an operator alone leaves."""
    return find_modes(alone.view, runs, _memories_of(alone), alone.beside_view())


def _behind_ringing(
    alone: OperatorFit, lag_s: float, runs: Sequence[AxisRun]
) -> tuple[OperatorFit, FittedModes | None]:
    """The operator alone and the modes that ring in what it leaves, fitted together where that leaves less."""
    ringing = _ringing_in(alone, runs)
    if ringing is None:
        return alone, ringing
    behind = replace(alone, view=ringing.adopted(alone.view)[0])
    again = fit_operator(runs, ringing.modes, lag_s)
    if _squares(again, again.modes, runs) > _squares(behind, ringing.modes, runs):
        return alone, ringing
    return _believed(alone, again, runs) or (alone, ringing)


def _placed(
    alone: OperatorFit, operator: OperatorFit, found: FittedModes | None, runs: Sequence[AxisRun]
) -> tuple[OperatorFit, FittedModes | None]:
    """Operator and modes of a grid fitted together, thresholds where they are, where that leaves less: at a tenth of
    its frequency a mode adds 1 % to the motion, which an operator fitted without it bends its loop for."""
    behind, modes = _behind(operator, found)
    placed = place_operator(runs, behind, modes)
    left = _squares(placed, placed.modes, runs)
    if left > _squares(behind, modes, runs):
        return operator, found
    if not placed.modes:
        return placed, None
    return placed, FittedModes(placed.modes, placed.view.delay_s, left / _squares(alone, (), runs))


def go_on(
    operator: OperatorFit, found: FittedModes | None, runs: Sequence[AxisRun]
) -> tuple[OperatorFit, FittedModes | None]:
    """A fit to records that have changed a little, from that to the records as they were: thresholds where they are,
    memories, delay and modes searched from there on."""
    placed = place_operator(runs, *_behind(operator, found))
    if found is None or not placed.modes:
        return placed, None
    return placed, replace(found, modes=placed.modes, delay_s=placed.view.delay_s)


def fit_straight(runs: Sequence[AxisRun]) -> OperatorFit:
    """Gain and offset of slow motion. Raises BadInput as ``fit_linear`` does.

    Where the records are broadband, what their response shows of lag and modes is fitted beside them: at its resonance
    a stage answers with another gain.
    """
    response = measured_response(runs)
    if not response.broadband:
        return fit_linear(runs)
    shown = modes_shown(response)
    return fit_linear(runs, shown.modes, shown.lag_s)


def _believed(
    alone: OperatorFit, joint: OperatorFit, runs: Sequence[AxisRun]
) -> tuple[OperatorFit, FittedModes] | None:
    """Operator and modes together where they leave much less than the operator alone."""
    if not joint.modes:
        return None
    left, left_alone = _squares(joint, joint.modes, runs), _squares(alone, (), runs)
    if not left < PAYS * left_alone:
        return None
    return joint, FittedModes(joint.modes, joint.view.delay_s, left / left_alone)


def _squares(operator: OperatorFit, modes: tuple[Mode, ...], runs: Sequence[AxisRun]) -> float:
    """Squared residual, each run in its own range."""
    return sum(share**2 for share in _shares_left(operator, modes, runs))


def _left_um(operator: OperatorFit, modes: tuple[Mode, ...], runs: Sequence[AxisRun]) -> list[Samples]:
    """What operator and modes leave of the scored rows of each run, (rows,)."""
    left = []
    beside = [*operator.beside_view(), *([effect_of_modes(modes)] if modes else [])]
    for run, turned_V in zip(runs, _memories_of(operator), strict=True):
        answer = _answer(operator.view, beside, run, turned_V)
        left.append((run.x_um - answer)[run.scored])
    return left


def _shares_left(operator: OperatorFit, modes: tuple[Mode, ...], runs: Sequence[AxisRun]) -> list[float]:
    """The same, rms about its mean in the range of each run."""
    each = zip(_left_um(operator, modes, runs), runs, strict=True)
    return [float(np.std(left_um)) / run.range_um for left_um, run in each]


def left_um_by(found: OperatorFit, modes: FittedModes | None, runs: Sequence[AxisRun]) -> list[Samples]:
    """What a fit leaves of the scored rows of each run, (rows,), with what it has of modes."""
    return _left_um(*_behind(found, modes), runs)


def shares_left_by(found: OperatorFit, modes: FittedModes | None, runs: Sequence[AxisRun]) -> list[float]:
    """The same, rms about its mean in the range of each run."""
    return _shares_left(*_behind(found, modes), runs)


def _behind(operator: OperatorFit, found: FittedModes | None) -> tuple[OperatorFit, tuple[Mode, ...]]:
    """The operator with the delay that goes with the modes, and these."""
    return (operator, ()) if found is None else (replace(operator, view=found.adopted(operator.view)[0]), found.modes)


def _memories_of(operator: OperatorFit) -> list[Turns | None]:
    """Of each of its records, the voltages at which the stage turned round before it; None where nothing tells."""
    return [record.turned_V for record in operator.records]


def _answer(view: TimeView, beside: Sequence[Entry], run: AxisRun, turned_V: Turns | None) -> Samples:
    """The operator's (n,), from the memory that the fit found for this record."""
    start = _plays_V(view, turned_V, run)
    return simulate(AxisModel(time=view), run.t_s, run.u_V, extra=beside, start=start, turned_V=turned_V)


def _plays_V(view: TimeView, turned_V: Turns | None, run: AxisRun) -> Samples | None:
    """Where the plays (m,) stand in the first row of a record. Where nothing tells from where it came it was from rest:
    None at 0 V; elsewhere the stage stood there when the record began, and no mode rings of the way."""
    first_V = float(run.u_V[0])
    if turned_V is None and abs(first_V) <= STILL_V:
        return None
    return plays_after(view, *(turned_V or ()), first_V)


@dataclass(frozen=True)
class _Ringing:
    """A run as the search sees it: the operator's answer and what it leaves (n,), relative to the run's range."""

    base: Samples
    residual: Samples
    step_s: float
    rows: slice | NDArray[np.intp]
    """To be looked at."""

    def moments(self, place: Place) -> Samples:
        """Covariance of ``columns`` over the rows; that of one mode is worked out in C, thousands of times."""
        if len(place) == 2:
            system = mode_coefficients(place[0] * self.step_s, place[1])
            left, across, late = second_order_residual(self.base, self._measured, system, self.step_s, self._rows)
            return np.array([[left, across], [across, late]])
        columns = self.columns(place)
        mean = columns.mean(axis=0)
        return np.asarray(columns.T @ columns / len(columns) - np.outer(mean, mean))

    def columns(self, place: Place) -> Samples:
        """(rows, 3): what the first of two modes leaves, how a later answer would change that, how the second would."""
        answer = resonant(self.base, place[0], place[1], self.step_s)
        late = np.diff(answer, prepend=answer[0]) / self.step_s
        second = answer - resonant(self.base, place[2], place[3], self.step_s)
        return np.stack([column[self._rows] for column in (self._measured - answer, late, second)], axis=1)

    def differenced(self) -> _Ringing:
        """Its second differences, in which what is slow hardly counts."""
        base, residual = (np.diff(x, 2, prepend=[x[0]] * 2) for x in (self.base, self.residual))
        return replace(self, base=base, residual=residual)

    @cached_property
    def _measured(self) -> Samples:
        return self.base + self.residual

    @cached_property
    def _rows(self) -> NDArray[np.uintp]:
        return np.arange(len(self.base), dtype=np.uintp)[self.rows]


def find_modes(
    view: TimeView,
    runs: Sequence[AxisRun],
    memories: Sequence[Turns | None] | None = None,
    beside: Sequence[Entry] = (),
) -> FittedModes | None:
    """The modes that explain most of what ``view`` leaves, or None: records too slow, or none pays.

    ``memories``: the voltages at which the stage turned round before each record, None for rest. ``beside``: what
    belongs to the operator and ``view`` does not hold.
    """
    of_runs = zip(runs, memories or [None] * len(runs), strict=True)
    fast = [(run, turned_V) for run, turned_V in of_runs if run.step_s <= 1 / SLOWEST_RATE_HZ]
    if len(fast) < 2:
        return None
    fast.sort(key=lambda one: len(one[0].t_s))  # fast sines ring most, and are short
    fitted, judged = _parts([_ringing(view, beside, *one) for one in fast[:MOST_RUNS]])
    nothing = sum(float(np.var(r.residual[r.rows])) for r in judged)
    if nothing < len(judged) * ROUNDING**2:
        return None
    one = _first(fitted)
    amounts = _amounts(fitted, one)
    squares = _squares_left(judged, one, amounts)
    if squares / nothing >= PAYS:
        return None
    alone = FittedModes(((1.0, one[0], one[1]),), max(view.delay_s + float(amounts[0]), 0.0), squares / nothing)
    two = _second(fitted, one)
    if two is None or two[2] < APART * two[0] or two[3] < UNDAMPED:
        return alone
    shift_s, share = _amounts(fitted, two).tolist()
    if abs(share) > MOST_SHARE:
        return alone
    squares_by_two = _squares_left(judged, two, np.array([shift_s, share]))
    if squares_by_two >= PAYS * squares and not _second_rings(judged, fitted, one, two):
        return alone
    modes = ((1 - share, two[0], two[1]), (share, two[2], two[3]))
    return FittedModes(modes, max(view.delay_s + shift_s, 0.0), squares_by_two / nothing)


def _second_rings(judged: Sequence[_Ringing], fitted: Sequence[_Ringing], one: Place, two: Place) -> bool:
    """Whether a second mode pays in the second differences of rows that it was not fitted on."""
    fine = [run.differenced() for run in judged]
    by_two = _squares_left(fine, two, _amounts(fitted, two))
    return by_two < SECOND_PAYS * _squares_left(fine, one, _amounts(fitted, one))


def _ringing(view: TimeView, beside: Sequence[Entry], run: AxisRun, turned_V: Turns | None) -> _Ringing:
    base = _answer(view, beside, run, turned_V)
    return _Ringing(base / run.range_um, (run.x_um - base) / run.range_um, run.step_s, run.scored)


def _parts(runs: Sequence[_Ringing]) -> tuple[list[_Ringing], list[_Ringing]]:
    """What to fit to and what to judge on."""
    if len(runs) >= FEW_RUNS:
        return list(runs[::2]), list(runs[1::2])
    parts: tuple[list[_Ringing], list[_Ringing]] = ([], [])
    for run in runs:
        rows = np.arange(len(run.base))[run.rows]
        for half in (0, 1):
            part = replace(run, rows=rows[(np.arange(len(rows)) * ALTERNATING_BLOCKS // len(rows)) % 2 == half])
            parts[half].append(part if half else part.differenced())
    return parts


def _peaks_Hz(residuals: Sequence[Samples], step_s: float, highest_Hz: float) -> list[float]:
    """Frequencies at which the spectrum of the residuals (n,) stands out most."""
    f_Hz = np.fft.rfftfreq(SPECTRUM_ROWS, step_s)
    density = np.sum([_density(residual) for residual in residuals], axis=0)
    density[(f_Hz < LOWEST_HZ) | (f_Hz > highest_Hz)] = 0.0
    around = np.lib.stride_tricks.sliding_window_view(np.pad(density, PEAK_WIDTH, mode="edge"), 2 * PEAK_WIDTH + 1)
    others = np.delete(around, PEAK_WIDTH, axis=1).max(axis=1)
    tops = np.flatnonzero(density > others)
    return [float(f_Hz[i]) for i in tops[np.argsort(-density[tops])][:PEAKS]]


def _density(x: Samples) -> Samples:
    """Two-sided spectral density (SPECTRUM_ROWS // 2 + 1,) of ``x`` (n,) per row: half-overlapping Hann windows.

    Welch 1967. ``scipy.signal.welch`` gives the same numbers, but the import of scipy.signal would make every
    ``phaselead fit`` a third slower.
    """
    length = min(len(x), SPECTRUM_ROWS)
    parts = np.lib.stride_tricks.sliding_window_view(x, length)[:: length - length // 2]
    window = np.hanning(length + 1)[:-1]
    waves = np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * window, SPECTRUM_ROWS)
    return np.asarray(np.mean(np.abs(waves) ** 2, axis=0) / np.sum(window**2))


def _tried_Hz(residuals: Sequence[Samples], step_s: float, highest_Hz: float) -> list[float]:
    """A grid of frequencies and the peaks of the residuals (n,)."""
    grid = np.geomspace(LOWEST_HZ, highest_Hz, TRIED_FREQUENCIES).tolist()
    return [*grid, *_peaks_Hz(residuals, step_s, highest_Hz)]


def _first(runs: Sequence[_Ringing]) -> Place:
    """Frequency and damping with the least residual: the best of those tried, then downhill from there."""
    step_s, few = runs[-1].step_s, runs[:TRIED_ON_RUNS]
    tried = _tried_Hz([run.residual for run in runs], step_s, FIRST_OF_RATE / step_s)
    start = min(product(tried, TRIED_ZETAS), key=lambda place: _least_squares(few, place))
    return _downhill(runs, start, FIRST_REACH)


def _second(runs: Sequence[_Ringing], one: Place) -> Place | None:
    """Both modes, the second where it explains most of what the first leaves; None where there is no room for one."""
    step_s, few = runs[-1].step_s, runs[:TRIED_ON_RUNS]
    residuals = [run.columns((*one, *one))[:, 0] for run in runs]
    tried = [f for f in _tried_Hz(residuals, step_s, SECOND_OF_RATE / step_s) if f > APART * one[0]]
    places = [(*one, f, zeta) for f, zeta in product(tried, TRIED_ZETAS)]
    if not places:
        return None
    return _downhill(runs, min(places, key=lambda place: _least_squares(few, place)), SECOND_REACH)


def _downhill(runs: Sequence[_Ringing], start: Place, reach: float) -> Place:
    """The place within the range that leaves least, downhill from ``start``; ``reach``: first relative steps."""
    first = np.log(start)
    highest_Hz = np.array([FIRST_OF_RATE, SECOND_OF_RATE])[: len(start) // 2] / runs[0].step_s

    def cost(logs: Samples) -> float:
        f_Hz, zeta = np.exp(logs[::2]), np.exp(logs[1::2])
        inside = (f_Hz >= LOWEST_HZ).all() and (f_Hz <= highest_Hz).all()
        if not (inside and (zeta >= ZETA[0]).all() and (zeta <= ZETA[1]).all()):
            return OUTSIDE_COST
        return _least_squares(runs, tuple(np.exp(logs).tolist()))

    simplex = first + np.vstack([np.zeros(len(first)), np.diag(np.tile([reach, ZETA_REACH], len(first) // 2))])
    enough = PRECISE * _least_squares(runs, start)
    options = {"initial_simplex": simplex, "maxfev": 40 * len(first), "xatol": 2e-4, "fatol": enough}
    found = minimize(cost, first, method="Nelder-Mead", options=options)
    return tuple(np.exp(found.x).tolist())


def _moments(runs: Sequence[_Ringing], place: Place) -> Samples:
    """(k, k), summed over the runs."""
    return np.asarray(np.sum([run.moments(place) for run in runs], axis=0))


def _best_amounts(moments: Samples) -> Samples:
    return np.asarray(-np.linalg.lstsq(moments[1:, 1:], moments[1:, 0], rcond=1e-12)[0])


def _amounts(runs: Sequence[_Ringing], place: Place) -> Samples:
    """By how much later the answer should come in s and, of two modes, the share of the second: least squares."""
    return _best_amounts(_moments(runs, place))


def _squares_left(runs: Sequence[_Ringing], place: Place, amounts: Samples) -> float:
    """Mean square that the modes at a place leave with given amounts, summed over the runs."""
    whole = np.array([1.0, *amounts])
    return float(whole @ _moments(runs, place) @ whole)


def _least_squares(runs: Sequence[_Ringing], place: Place) -> float:
    """The same with the best amounts."""
    moments = _moments(runs, place)
    whole = np.array([1.0, *_best_amounts(moments)])
    return float(whole @ moments @ whole)
