"""Fit of the time-domain view: reversible slopes, plays, delay, offset and memory, from any records.

For a given delay and resting memory the model is linear with no negative coefficient, so those two are
searched and everything else is solved for (variable projection, Golub & Pereyra 1973). How many plays and
segments the data carry is decided on data left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from phaselead.identify.memory import OTHER_MEMORY, came_from, settled
from phaselead.identify.operator_design import (
    Basis,
    FitRun,
    centred,
    design,
    fit_run,
    gram,
    group_numbers,
    nested_basis,
    time_view,
)
from phaselead.identify.operator_result import (
    Choice,
    OperatorFit,
    RecordResidual,
    effective_rows,
    standard_errors,
)
from phaselead.identify.operator_search import least_error
from phaselead.identify.operator_solve import Solved, solve, solved_at
from phaselead.identify.runs import AxisRun, distinct, longest_delay_s, period_s
from phaselead.model import Mode, TimeView
from phaselead.record import Samples

MOST_ROWS, SEARCH_ROWS = 30_000, 12_000
FINEST = (48, 20)
"""Plays and segments of the richest candidate; the others are every 2nd, 4th ... of it."""
PLAY_STRIDES, SEGMENT_MERGES = (1, 2, 4, 8, 0), (1, 2, 4, 10, 20)
SEARCH = (12, 10)
BLOCKS = 6
"""Stretches of time into which few records are split, to leave out one after the other."""
SIMPLER = 1.02
"""The simplest candidate wins whose error on data left out is at most this times the least."""
LONGEST_DELAY = 0.1
"""Of a period."""
SHORTER_DELAY = 1.05
"""On records of one frequency a delay looks like more play: the shortest is taken that costs at most this
factor."""
OFFSETS_DIFFER = 0.01
"""Of the range: when the median record is further off, every one gets an offset of its own."""


def fit_operator(runs: Sequence[AxisRun]) -> OperatorFit:
    """Fit the time view to one axis of one or more records, each from rest or warmed by the rows before its
    window.

    Raises BadInput for data that determine nothing.
    """
    search = _fit_runs(runs, SEARCH_ROWS)
    low, high = _voltage_range(runs)
    basis = nested_basis(_largest_swing(runs), low, high, *SEARCH)
    messages: list[str] = []
    bound = _delay_bound(runs)
    sure = [settled(f) for f in search]
    first = least_error(sure, basis, bound, False, (0.02 * bound, 0.0))
    delay, rest = first.delay_s, first.rest_fraction
    own_offsets = _offsets_differ(sure, basis, delay, rest)
    if own_offsets:
        messages.append("the records differ in offset by more than 1 % of their range: each has its own")
    basis, _ = _choose(sure, runs, low, high, delay, rest)
    slopes = solved_at(sure, basis, delay, rest, own_offsets)
    moved, odd = came_from(search, lambda f: _residual(f, basis, delay, rest, slopes), own_offsets)
    at_rest = least_error(search, basis, bound, own_offsets, (delay, 0.0))
    if odd:
        elsewhere = least_error(moved, basis, bound, own_offsets, (delay, rest))
        if elsewhere.error**2 < OTHER_MEMORY * at_rest.error**2:
            search, at_rest = moved, elsewhere
            messages += odd
    delay, rest = at_rest.delay_s, at_rest.rest_fraction
    finer, choices = _choose(search, runs, low, high, delay, rest)
    if not finer.equals(basis):
        again = least_error(search, finer, bound, own_offsets, (delay, rest))
        delay, rest = again.delay_s, again.rest_fraction
        finer, choices = _choose(search, runs, low, high, delay, rest)
    basis = finer
    if not _rest_matters(search, basis, delay, rest, own_offsets):
        rest = 0.0
        messages.append("no record starts from rest: the memory at rest is unknown and taken as 0")
    if _one_frequency(runs):
        delay, rest = _shortest_delay(search, basis, delay, rest, own_offsets)
        messages.append("one frequency cannot tell delay from play: the shortest delay that fits was taken")
    full = [replace(f, came_from_V=s.came_from_V) for f, s in zip(_fit_runs(runs, MOST_ROWS), search, strict=True)]
    return _result(full, basis, delay, rest, own_offsets, choices, tuple(messages))


def refit_operator(runs: Sequence[AxisRun], known: OperatorFit, modes: tuple[Mode, ...]) -> OperatorFit:
    """The operator fitted again with modes behind it: memories and offsets of the records stay as they were known."""
    past = [record.came_from_V for record in known.records]
    own_offsets, view = known.own_offsets, known.view

    def fits(rows: int) -> list[FitRun]:
        made = _fit_runs(runs, rows, modes)
        return [replace(f, came_from_V=v) for f, v in zip(made, past, strict=True)]

    low, high = _voltage_range(runs)
    search = fits(SEARCH_ROWS)
    start = (view.delay_s, view.rest_fraction or 0.01)
    basis = nested_basis(_largest_swing(runs), low, high, *SEARCH)
    found = least_error(search, basis, _delay_bound(runs), own_offsets, start)
    basis, choices = _choose(search, runs, low, high, found.delay_s, found.rest_fraction)
    return _result(fits(MOST_ROWS), basis, found.delay_s, found.rest_fraction, own_offsets, choices, known.messages)


def fit_linear(runs: Sequence[AxisRun]) -> OperatorFit:
    """Gain and offset only, no memory and no delay."""
    full = _fit_runs(runs, MOST_ROWS)
    low, high = _voltage_range(runs)
    return _result(full, nested_basis(1.0, low, high, 0, 1), 0.0, 0.0, False, (), ())


def _fit_runs(runs: Sequence[AxisRun], rows: int, modes: tuple[Mode, ...] = ()) -> list[FitRun]:
    each = max(200, rows // len(runs))
    blocks = 1 if len(runs) >= BLOCKS else -(-BLOCKS // len(runs))
    return [fit_run(run, each, i * blocks, blocks, modes) for i, run in enumerate(runs)]


def _voltage_range(runs: Sequence[AxisRun]) -> tuple[float, float]:
    return min(float(r.u_V.min()) for r in runs), max(float(r.u_V.max()) for r in runs)


def _largest_swing(runs: Sequence[AxisRun]) -> float:
    return max(float(np.ptp(r.u_V[r.scored])) for r in runs)


def _delay_bound(runs: Sequence[AxisRun]) -> float:
    return min(min(LONGEST_DELAY * period_s(r), longest_delay_s(r)) for r in runs)


def _rest_matters(fits: list[FitRun], basis: Basis, delay: float, rest: float, own_offsets: bool) -> bool:
    errors = [solved_at(fits, basis, delay, r, own_offsets).error for r in (rest, -0.9, 0.9)]
    return max(errors) > 1.001 * errors[0]


def _one_frequency(runs: Sequence[AxisRun]) -> bool:
    sines = [run.sine for run in runs]
    found = [sine.f_Hz for sine in sines if sine is not None]
    return len(found) == len(runs) and max(found) < 1.5 * min(found)


def _shortest_delay(
    fits: list[FitRun], basis: Basis, delay: float, rest: float, own_offsets: bool
) -> tuple[float, float]:
    allowed = SHORTER_DELAY * solved_at(fits, basis, delay, rest, own_offsets).error
    if solved_at(fits, basis, 0.0, rest, own_offsets).error <= allowed:
        return 0.0, rest
    low, high = 0.0, delay
    for _ in range(10):
        middle = (low + high) / 2
        if solved_at(fits, basis, middle, rest, own_offsets).error > allowed:
            low = middle
        else:
            high = middle
    return high, rest


def _residual(fit: FitRun, basis: Basis, delay: float, rest: float, solved: Solved) -> Samples:
    return fit.position() - solved.at_rest_um - design(fit, basis, delay, rest) @ solved.slopes


def _residuals(fits: list[FitRun], basis: Basis, delay: float, rest: float, solved: Solved) -> list[Samples]:
    return [_residual(f, basis, delay, rest, solved) for f in fits]


def _offsets_differ(fits: list[FitRun], basis: Basis, delay: float, rest: float) -> bool:
    """Whether the median record sits far from the common offset; one that does has another past."""
    left = _residuals(fits, basis, delay, rest, solved_at(fits, basis, delay, rest, False))
    offsets = [abs(e.mean()) / f.run.range_um for e, f in zip(left, fits, strict=True)]
    return float(np.median(offsets)) > OFFSETS_DIFFER


def _choose(
    fits: list[FitRun], runs: Sequence[AxisRun], low: float, high: float, delay: float, rest: float
) -> tuple[Basis, tuple[Choice, ...]]:
    """The simplest basis that predicts left-out data as well as any."""
    fine = nested_basis(_largest_swing(runs), low, high, *FINEST)
    moments = centred(gram(fits, fine, delay, rest))
    folds = _folds(fits)
    choices, bases = [], []
    for stride, merge in product(PLAY_STRIDES, SEGMENT_MERGES):
        shrink, basis = _coarser(fine, stride, merge)
        smaller = shrink.T @ moments @ shrink
        choices.append(
            Choice(len(basis.play_r_V), len(basis.knots_V) - 1, _left_out(smaller, len(basis.knots_V) - 1, folds))
        )
        bases.append(basis)
    least = min(c.left_out for c in choices)
    good = [i for i, c in enumerate(choices) if c.left_out <= SIMPLER * least]
    best = min(good, key=lambda i: (choices[i].n_plays + choices[i].n_segments, choices[i].left_out))
    return bases[best], tuple(replace(c, chosen=i == best) for i, c in enumerate(choices))


def _coarser(fine: Basis, stride: int, merge: int) -> tuple[Samples, Basis]:
    """Every ``stride``-th play (0: none) and ``merge`` segments in one; and the matrix that shrinks the
    moments."""
    segments, m = len(fine.knots_V) - 1, len(fine.play_r_V)
    joined = np.kron(np.eye(segments // merge), np.ones((merge, 1)))
    kept = np.eye(m)[:, stride - 1 :: stride] if stride else np.zeros((m, 0))
    shrink = np.zeros((fine.size + 2, joined.shape[1] + kept.shape[1] + 2))
    shrink[:segments, : joined.shape[1]] = joined
    shrink[segments : segments + m, joined.shape[1] : -2] = kept
    shrink[-2:, -2:] = np.eye(2)
    return shrink, Basis(fine.play_r_V @ kept, fine.knots_V[::merge])


def _folds(fits: list[FitRun]) -> list[Samples]:
    """Groups to leave out together: a level of drive at a time, or a stretch of time when there are few
    levels.

    The highest level always stays: what lies beyond all data is extrapolation, and no basis is to be judged
    by it.
    """
    groups = len(group_numbers(fits))
    swings = [float(np.ptp(f.run.u_V[f.run.scored])) for f in fits]
    levels = distinct(swings)
    if len(fits) >= BLOCKS and len(levels) >= 4:
        nearest = [int(np.argmin(np.abs(np.subtract(levels, s)))) for s in swings]
        return [np.equal(nearest, level) for level in range(len(levels) - 1)]
    return [np.arange(groups) % BLOCKS == fold for fold in range(BLOCKS)]


def _left_out(moments: Samples, n_segments: int, folds: list[Samples]) -> float:
    """Relative rms error on folds left out; ``moments`` are centred group by group."""
    total, squares, count = moments.sum(axis=0), 0.0, 0
    for fold in folds:
        out = moments[fold.astype(bool)].sum(axis=0)
        slopes = solve((total - out)[None] + _unit_offset(total), n_segments, False).slopes
        inner, right = out[:-2, :-2], out[:-2, -1]
        squares += max(float(out[-1, -1] - 2 * right @ slopes + slopes @ inner @ slopes), 0.0)
        count += 1
    return float(np.sqrt(squares / count))


def _unit_offset(moments: Samples) -> Samples:
    """Centred moments carry no offset; a unit in its place keeps ``solve`` from dividing by zero."""
    unit = np.zeros_like(moments)
    unit[-2, -2] = 1.0
    return unit


def _result(
    fits: list[FitRun],
    basis: Basis,
    delay: float,
    rest: float,
    own_offsets: bool,
    choices: tuple[Choice, ...],
    messages: tuple[str, ...],
) -> OperatorFit:
    solved = solved_at(fits, basis, delay, rest, own_offsets)
    left = _residuals(fits, basis, delay, rest, solved)
    if own_offsets:
        at_rest = solved.at_rest_um + float(np.median([e.mean() for e in left]))
        solved = replace(solved, at_rest_um=at_rest)
        left = _residuals(fits, basis, delay, rest, solved)
    view = time_view(basis, solved.slopes, solved.at_rest_um, delay, rest, 1.0 / fits[0].run.step_s)
    residual = float(np.sqrt(np.mean(np.concatenate(left) ** 2)))
    return OperatorFit(
        TimeView(**{**view.model_dump(), "residual_um_rms": residual}),
        standard_errors(fits, basis, delay, rest, solved.slopes, left),
        tuple(RecordResidual.of(f, e) for f, e in zip(fits, left, strict=True)),
        choices,
        messages,
        sum(effective_rows(e) for e in left),
        own_offsets,
    )
