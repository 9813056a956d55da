"""Whether records creep beside the operator that is fitted to them, and how much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phaselead.identify.operator.choosing import FINEST
from phaselead.identify.operator.creep import Creep
from phaselead.identify.operator.regressors import FitRun, design_matrix
from phaselead.identify.operator.result import OperatorFit, apart_from, effective_rows
from phaselead.identify.operator.session import as_known
from phaselead.identify.operator.solution import CHANCE_GAIN, EXACT, Solution, moments_of, solve_slopes
from phaselead.identify.runs import AxisRun, one_frequency
from phaselead.model import MOST_CREEP, AxisModel, Mode, Parameter, effect_of_creep, lags
from phaselead.record import Samples

FIRST_ROWS, FIRST_OF_RECORD = 10, 0.1
"""Where creep may begin: from so many rows on to this share of the longest record."""
FIRSTS_A_DECADE = 2
"""Beginnings that are tried: a straight line that begins half a decade off is as good but for its first half decade."""
BEYOND = 10.0
"""Times the longest record that creep goes on for: what is slower is an offset to all of them."""


def creep_beside(runs: Sequence[AxisRun], known: OperatorFit, modes: tuple[Mode, ...]) -> Creep | None:
    """What creeps beside an operator of the most plays and segments, at the delay, the memories and the modes of
    ``known``; None where chance may leave as little, or a quick lag does, or where nothing tells it.

    ``runs`` are as measured, with the creep that ``known`` has.
    """
    if one_frequency(runs):
        return None
    records = as_known(runs, known, modes)
    fine = records.basis(*FINEST, fading=len(known.fading_r_V) > 0)
    less = records if known.creep is None else replace(records, fits=[_less(f, known.creep) for f in records.fits])
    found = less.at(fine, known.view.delay_s, known.view.rest_fraction, modes)
    if found.error < EXACT:
        return None
    tried, beside = _tried(records.runs), AxisModel(time=known.view)
    um_per_V = float(found.slopes[: fine.n_segments].mean())
    if not um_per_V > 0:  # of a stage that hardly moves nothing creeps
        return None
    terms = [one.terms for one in tried]
    terms += [(np.ones(1), np.array([tau_s])) for tau_s in _quick_s(records.runs)]
    each = (_columns(f, of.run, found, terms, um_per_V, beside) for f, of in zip(records.fits, less.fits, strict=True))
    of_all = moments_of(records.fits, each, fine.size + len(terms) + 2).sum(axis=0)
    of_all[-2, -2] = 1.0  # the columns are about their means: a unit in place of the offset
    _, without = _solved(of_all, fine.size, fine.n_segments, None)
    solved = [_solved(of_all, fine.size, fine.n_segments, i) for i in range(len(terms))]
    best = min(range(len(tried)), key=lambda i: solved[i][1])
    amount, error = solved[best]
    one_lag = min((left for _, left in solved[len(tried) :]), default=np.inf)
    rows = sum(effective_rows(found.residual(f)) for f in less.fits)
    if not without > error * np.exp(CHANCE_GAIN / 2 / rows) or one_lag < error:
        return None
    k, _ = tried[best].terms
    return replace(tried[best], per_decade=min(amount / um_per_V, MOST_CREEP / float(k.sum()), _catalogue()[0].high))


def _less(fit: FitRun, creep: Creep) -> FitRun:
    return replace(fit, run=creep.taken_from(fit.run))


def _tried(runs: Sequence[AxisRun]) -> list[Creep]:
    """Of 1 per decade, by where it begins; within the range of the catalogue."""
    _, first, last = _catalogue()
    longest_s = max(float(run.t_s[-1] - run.t_s[0]) for run in runs)
    low_s = _within(first, FIRST_ROWS * min(run.step_s for run in runs))
    high_s = max(_within(first, FIRST_OF_RECORD * longest_s), low_s)
    return [Creep(1.0, first_s, _within(last, BEYOND * longest_s)) for first_s in _by_half_decades(low_s, high_s)]


def _quick_s(runs: Sequence[AxisRun]) -> list[float]:
    """Time constants, in s, of a single lag of an amplifier or a sensor: up to where creep typically begins."""
    low_s, high_s = FIRST_ROWS * min(run.step_s for run in runs), _catalogue()[1].typical
    return _by_half_decades(low_s, high_s) if low_s < high_s else []


def _by_half_decades(low_s: float, high_s: float) -> list[float]:
    count = 1 + round(FIRSTS_A_DECADE * float(np.log10(high_s / low_s)))
    return [float(at_s) for at_s in np.geomspace(low_s, high_s, count)]


def _catalogue() -> tuple[Parameter, Parameter, Parameter]:
    """Of creep: how much there is per decade, where it begins and where it ends."""
    effect, params = effect_of_creep(0.0, 0.0, 0.0)
    by_name = {p.name: p for p in effect.parameters}
    per_decade, first, last = (by_name[name] for name in params)
    return per_decade, first, last


def _within(p: Parameter, value: float) -> float:
    """Moved into the range of its parameter."""
    return float(np.clip(value, p.low, p.high))


def _columns(
    fit: FitRun,
    moved: AxisRun,
    found: Solution,
    terms: Sequence[tuple[Samples, Samples]],
    um_per_V: float,
    axis: AxisModel,
) -> Samples:
    """(rows, slopes + terms + 2): a unit of each slope, of the lags of each of the ``terms`` after what ``moved`` less
    creep, in V as the slopes are, a column for the offset and the measured position, all about their means and apart
    from what was before."""
    of_slopes = design_matrix(fit, found.basis, found.delay_s, found.rest_fraction, found.modes)
    lagging = [lags(moved.x_um / um_per_V, tau_s, k, fit.run.step_s)[fit.rows] for k, tau_s in terms]
    rest = np.stack([*lagging, np.ones(len(fit.rows)), fit.position()], axis=1)
    left_um = fit.position() - of_slopes @ found.slopes
    return apart_from_before(np.concatenate([of_slopes, rest], axis=1), left_um, fit.run, fit.rows, axis)


def apart_from_before(
    columns: Samples, left_um: Samples, run: AxisRun, rows: NDArray[np.uintp], axis: AxisModel
) -> Samples:
    """Columns (rows, k) about their means, without what may have crept on from before the record began on a stage that
    creeps as much as is typical, as much of it as ``left_um`` (rows,) tells."""
    per_decade, first, last = _catalogue()
    ends_s = _within(first, FIRST_ROWS * run.step_s), _within(last, BEYOND * float(run.t_s[-1] - run.t_s[0]))
    effect, params = Creep(per_decade.typical, *ends_s).entry
    assert effect.before_record is not None
    before = effect.before_record((run.t_s - run.t_s[0])[rows], params, axis)
    return apart_from(columns, before, left_um)


def _solved(of_all: Samples, slopes: int, n_segments: int, term: int | None) -> tuple[float, float]:
    """The amount in um/V of one of the terms beside the slopes, or 0 of none, and the relative error that is left."""
    kept = [*range(slopes), *([] if term is None else [slopes + term]), len(of_all) - 2, len(of_all) - 1]
    found, _, error = solve_slopes(of_all[np.ix_(kept, kept)][None], n_segments, 1.0)
    return (0.0 if term is None else float(found[-1])), error
