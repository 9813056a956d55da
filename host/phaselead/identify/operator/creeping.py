"""Whether records creep beside the operator that is fitted to them, and how much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phaselead.identify.operator.choosing import FINEST
from phaselead.identify.operator.creep import Creep
from phaselead.identify.operator.regressors import FitRun, design_matrix
from phaselead.identify.operator.result import OperatorFit, effective_rows
from phaselead.identify.operator.session import as_known
from phaselead.identify.operator.solution import EXACT, PART_PAYS, Solution, moments_of, solve_slopes
from phaselead.identify.runs import AxisRun, one_frequency
from phaselead.model import AxisModel, Mode, lags
from phaselead.record import Samples

FIRST_ROWS, FIRST_OF_RECORD = 10, 0.1
"""Where creep may begin: from so many rows on to this share of the longest record."""
FIRSTS_A_DECADE = 2
"""Beginnings that are tried: a straight line that begins half a decade off is as good but for its first half decade."""
BEYOND = 10.0
"""Times the longest record that creep goes on for: what is slower is an offset to all of them."""
TYPICAL = 0.015
"""Per decade, of ceramics (catalogue of Physik Instrumente: 1 to 2 %): how much may go on from before a record."""
MOST_LAGGING = 0.5
"""Sum of the lags' shares: the device inverts no more."""


def creep_beside(runs: Sequence[AxisRun], known: OperatorFit, modes: tuple[Mode, ...]) -> Creep | None:
    """What creeps beside an operator of the most plays and segments, at the delay, the memories and the modes of
    ``known``; None where that does not leave much less, or cannot be told.

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
    tried = _tried(records.runs)
    beside = AxisModel(time=known.view)
    each = (_columns(f, of.run, found, tried, beside) for f, of in zip(records.fits, less.fits, strict=True))
    of_all = moments_of(records.fits, each, fine.size + len(tried) + 2).sum(axis=0)
    of_all[-2, -2] = 1.0  # the columns are about their means: a unit in place of the offset
    _, without = _solved(of_all, fine.size, fine.n_segments, None)
    solved = [_solved(of_all, fine.size, fine.n_segments, i) for i in range(len(tried))]
    best = min(range(len(tried)), key=lambda i: solved[i][1])
    amount, error = solved[best]
    if not error**2 < PART_PAYS * without**2:
        return None
    k, _ = tried[best].terms
    return replace(tried[best], per_decade=min(amount, MOST_LAGGING / float(k.sum())))


def _less(fit: FitRun, creep: Creep) -> FitRun:
    return replace(fit, run=creep.taken_from(fit.run))


def _tried(runs: Sequence[AxisRun]) -> list[Creep]:
    """Of 1 per decade, by where it begins."""
    longest_s = max(float(run.t_s[-1] - run.t_s[0]) for run in runs)
    low_s = FIRST_ROWS * min(run.step_s for run in runs)
    high_s = max(FIRST_OF_RECORD * longest_s, low_s)
    count = 1 + round(FIRSTS_A_DECADE * float(np.log10(high_s / low_s)))
    return [Creep(1.0, first_s, BEYOND * longest_s) for first_s in np.geomspace(low_s, high_s, count).tolist()]


def _columns(fit: FitRun, moved: AxisRun, found: Solution, tried: Sequence[Creep], axis: AxisModel) -> Samples:
    """(rows, slopes + tried + 2): a unit of each slope, of each way to creep after what ``moved`` without it, a column
    for the offset and the measured position, all about their means and apart from what was before."""
    of_slopes = design_matrix(fit, found.basis, found.delay_s, found.rest_fraction, found.modes)
    crept = []
    for creep in tried:
        k, tau_s = creep.terms
        crept.append(lags(moved.x_um, tau_s, k, fit.run.step_s)[fit.rows])
    rest = np.stack([*crept, np.ones(len(fit.rows)), fit.position()], axis=1)
    left_um = fit.position() - of_slopes @ found.slopes
    return apart_from_before(np.concatenate([of_slopes, rest], axis=1), left_um, fit.run, fit.rows, axis)


def apart_from_before(
    columns: Samples, left_um: Samples, run: AxisRun, rows: NDArray[np.uintp], axis: AxisModel
) -> Samples:
    """Columns (rows, k) about their means, without what may have crept on from before the record began, as much of it
    as ``left_um`` (rows,) tells."""
    effect, params = Creep(TYPICAL, FIRST_ROWS * run.step_s, BEYOND * float(run.t_s[-1] - run.t_s[0])).entry
    assert effect.before_record is not None
    before = effect.before_record((run.t_s - run.t_s[0])[rows], params, axis)
    columns, before = columns - columns.mean(axis=0), before - before.mean(axis=0)
    told = before.T @ before + float(np.var(left_um)) * len(rows) / effective_rows(left_um) * np.eye(before.shape[1])
    return np.asarray(columns - before @ np.linalg.solve(told, before.T @ columns))


def _solved(of_all: Samples, slopes: int, n_segments: int, creeping: int | None) -> tuple[float, float]:
    """The amount of one way to creep beside the slopes, or 0 of none, and the relative error that is left."""
    kept = [*range(slopes), *([] if creeping is None else [slopes + creeping]), len(of_all) - 2, len(of_all) - 1]
    found, _, error = solve_slopes(of_all[np.ix_(kept, kept)][None], n_segments, 1.0)
    return (0.0 if creeping is None else float(found[-1])), error
