"""Fits of the time view to records of one axis: reversible slopes, plays, delay, offset, memory, and modes behind it.

How many plays and segments the records carry is decided on data left out; a mode stays where it pays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import minimize_scalar

from phaselead.identify.operator.leaving_out import FOLD_BLOCKS, SIMPLER, folds_of, left_out
from phaselead.identify.operator.likeliest import likeliest_slopes
from phaselead.identify.operator.placing import fewest_knots, paired_plays
from phaselead.identify.operator.regressors import (
    FADING,
    FEWEST_ROWS,
    Basis,
    FitRun,
    Turns,
    nested_basis,
    ringing_s,
    rows_to_fit,
)
from phaselead.identify.operator.result import (
    Choice,
    OperatorFit,
    RecordResidual,
    effective_rows,
    standard_errors,
)
from phaselead.identify.operator.solution import (
    EXACT,
    REST_STEP,
    Solution,
    best_operator,
    best_slopes,
    centred,
    moments,
)
from phaselead.identify.operator.starting_memories import (
    LIKELY_MEMORY,
    OTHER_MEMORY,
    settled_of,
    told_memories,
    with_memories,
)
from phaselead.identify.runs import AxisRun, longest_delay_s, period_s
from phaselead.model import LONGEST_DELAY_S, PLAYS, PLAYS_ALIKE, Mode
from phaselead.record import Samples

MOST_ROWS, SEARCH_ROWS = 30_000, 12_000
"""Of all records: for the result, and while searching."""
FINEST = (48, 20)
"""Plays and segments of the richest size; the others are every 2nd, 4th ... of it."""
PLAY_STRIDES, SEGMENT_MERGES = (1, 2, 4, 8, 0), (1, 2, 4, 10, 20)
BESIDE_FADING = PLAYS - PLAYS_ALIKE * len(FADING)
"""Plays beside fading ones at most: the device has plays in the place of those. There are some in any case, which tell
where a record began."""
SEARCH = (12, 10)
"""Plays and segments before a size is chosen."""
LONGEST_DELAY = 0.1
"""Of a period."""
FIRST_DELAY = 0.02
"""Of the longest delay: where the search starts."""
SHORTER_DELAY = 1.05
"""On records of one frequency a delay looks like more play: the shortest is taken that costs at most this factor."""
MEMORY_TURNS = 4
"""How often memories are told by the operator that went with those of before."""
REST_MATTERS = 1.001
"""The memory at rest is known when other rest fractions cost more than this factor in error."""
PLACED_TURNS, PLACED = 3, 0.98
"""How often thresholds are placed anew, at the delay and the modes that go with those of before; done when the error
stays above this share of what it was."""
MODE_PAYS = 0.9
"""A mode stays in when the squared residual with it is less than this share of that without."""

LAG_STEP = 0.001
"""Of the longest lag: how finely the best one is searched. A hundredth was several standard errors."""
SHORTEST_LAG = 0.02
"""Of the longest lag. What the operator misses of a stage without a lag looks like a short one, 2.5 of 400 us at most
(a stage with two modes, late by one row, four draws of the noise), and a lag of up to twice that would gain as well."""
CHANCE_GAIN = 2.71
"""Twice the log likelihood that one parameter gains by chance in one of twenty cases where it cannot be negative: in
half of them it gains nothing (Chernoff 1954)."""


@dataclass(frozen=True)
class _Records:
    """The records of one axis, thinned, and whether each has an offset of its own."""

    runs: Sequence[AxisRun]
    fits: list[FitRun]
    own_offsets: bool = False
    lag_s: float = 0.0
    """Of the measured response, where that is known: the delay may be twice as long, however short the periods."""

    def behind_a_lag(self, lag_s: float) -> _Records:
        """The same with a low-pass of this time constant in front of the operator."""
        return replace(self, fits=[replace(f, lag_s=lag_s) for f in self.fits])

    def settled(self) -> _Records:
        """The rows that remember nothing of what was before their record but an offset, which each then has."""
        return replace(self, fits=settled_of(self.fits), own_offsets=True)

    @cached_property
    def longest_delay_s(self) -> float:
        of_periods = min(LONGEST_DELAY * period_s(r) for r in self.runs)
        return min(max(of_periods, 2 * self.lag_s), *(longest_delay_s(r) for r in self.runs), LONGEST_DELAY_S)

    def basis(self, n_plays: int, n_segments: int, *, fading: bool = False) -> Basis:
        low = min(float(r.u_V.min()) for r in self.runs)
        high = max(float(r.u_V.max()) for r in self.runs)
        swing = max(float(np.ptp(r.u_V[r.scored])) for r in self.runs)
        return nested_basis(swing, low, high, n_plays, n_segments, fading=fading)

    def at(self, basis: Basis, delay_s: float, rest_fraction: float, modes: tuple[Mode, ...] = ()) -> Solution:
        return best_slopes(self.fits, basis, delay_s, rest_fraction, self.own_offsets, modes)

    def searched(
        self, basis: Basis, delay_s: float, rest_fraction: float, modes: tuple[Mode, ...] = (), *, whole: bool = False
    ) -> Solution:
        """The best operator of a basis and the best modes behind it, from there on."""
        start = (delay_s, rest_fraction)
        return best_operator(self.fits, basis, self.longest_delay_s, self.own_offsets, start, modes, whole=whole)


def fit_operator(runs: Sequence[AxisRun], modes: tuple[Mode, ...] = (), lag_s: float = 0.0) -> OperatorFit:
    """Fit the time view to one axis of one or more records, each from rest or warmed by the rows before its window.

    ``modes``: about where the mechanics have some; those that pay are fitted together with the operator. ``lag_s``:
    what else the measured response lags. Raises BadInput for data that determine nothing.
    """
    records = _Records(runs, _thinned(runs, SEARCH_ROWS, ringing_s=ringing_s(modes)), lag_s=lag_s)
    records, found, messages = _with_memories(records, modes)
    basis, choices = _choose_basis(records, found)
    if not basis.equals(found.basis):
        found = records.searched(basis, found.delay_s, found.rest_fraction, found.modes)
        basis, choices = _choose_basis(records, found)
    lag_share = 0.0
    if modes:
        found = _paying(records, replace(found, basis=basis))
        basis, choices = _choose_basis(records, found)
        without = records.at(basis, found.delay_s, found.rest_fraction, found.modes)
        records, found = _lagging(records, without)
        basis, choices = _choose_basis(records, found)
        lag_share = 1 - (found.error / without.error) ** 2 if records.fits[0].lag_s else 0.0
    delay_s, rest = found.delay_s, found.rest_fraction
    if not _rest_matters(records, basis, found):
        rest = 0.0
        messages.append("no record starts from rest: the memory at rest is unknown and taken as 0")
    if _one_frequency(runs):
        delay_s = _shortest_delay_s(records, basis, delay_s, rest)
        messages.append("one frequency cannot tell delay from play: the shortest delay that fits was taken")
    found = replace(found, basis=basis, delay_s=delay_s, rest_fraction=rest)
    return replace(_of_all_rows(records, found, modes, choices, messages), lag_share=lag_share)


def _with_memories(records: _Records, modes: tuple[Mode, ...]) -> tuple[_Records, Solution, list[str]]:
    """The records with the memories and offsets that explain them best, the operator then, and what to say of them."""
    first = _of_settled_rows(records, modes)
    common = _told_apart(records, first)
    told, found, _ = common
    free = replace(told, own_offsets=True).at(found.basis, found.delay_s, found.rest_fraction, found.modes)
    if not free.error**2 < OTHER_MEMORY * found.error**2:
        return common
    apart, found, said = _told_apart(replace(records, own_offsets=True), first)
    offsets_um = [float(found.residual(f).mean()) for f in apart.fits]
    return apart, found, [f"the records differ in offset by {np.ptp(offsets_um):.3g} um: each has its own", *said]


def _of_settled_rows(records: _Records, modes: tuple[Mode, ...]) -> Solution:
    """The operator of the rows that remember nothing of what was before their record but an offset."""
    late = records.settled()
    return late.searched(late.basis(*SEARCH), _first_delay_s(late), 0.0, modes)


def _told_apart(records: _Records, first: Solution) -> tuple[_Records, Solution, list[str]]:
    """The same where it is known whether each record has an offset of its own; ``first`` is of settled rows.

    Memories are told by an operator and the operator goes with the memories: what a wrong one made of a record is told
    anew by the operator that the others led to.
    """
    late = records.settled()
    basis, _ = _choose_basis(late, first)
    at_rest = records.searched(basis, first.delay_s, 0.0, first.modes)
    best: tuple[_Records, Solution, list[str]] = records, at_rest, []
    told: list[list[Turns | None]] = []
    for found in (late.at(basis, first.delay_s, first.rest_fraction, first.modes), at_rest):
        for turn in range(MEMORY_TURNS):
            share, own_offsets = (OTHER_MEMORY, records.own_offsets) if turn else (LIKELY_MEMORY, True)
            moved, said = with_memories(records.fits, found, share, own_offsets)
            memories = [f.turned_V for f in moved]
            if not said or memories in told:
                break
            told.append(memories)
            elsewhere = replace(records, fits=moved)
            found = elsewhere.searched(basis, first.delay_s, first.rest_fraction, first.modes)
            if found.error < best[1].error and _tell_better(elsewhere, found, at_rest):
                best = elsewhere, found, said
    return best


def _tell_better(elsewhere: _Records, found: Solution, at_rest: Solution) -> bool:
    """Whether the memories leave clearly less of the records that have one than if all had come from rest."""
    own = elsewhere.own_offsets
    moved = [fit for fit in elsewhere.fits if fit.turned_V is not None]
    gains = [_square(found, f, own) / _square(at_rest, replace(f, turned_V=None), own) for f in moved]
    return float(np.exp(np.mean(np.log(gains)))) < OTHER_MEMORY


def _square(found: Solution, fit: FitRun, own_offset: bool) -> float:
    """Mean square that is left of a record, at least what rounding leaves."""
    e = found.residual(fit)
    return float(np.var(e) if own_offset else np.mean(e**2)) + (EXACT * fit.run.range_um) ** 2


def _known_rest(rest_fraction: float) -> float:
    """Where a search goes on from: a start at 0 would stand for a memory that nobody knows, and have a grid tried."""
    return rest_fraction or REST_STEP / 2


def _first_delay_s(records: _Records) -> float:
    return min(max(FIRST_DELAY * records.longest_delay_s, records.lag_s), records.longest_delay_s)


def _paying(records: _Records, found: Solution) -> Solution:
    """The operator without the modes that do not pay, and with all of the motion carried by the only one if that
    costs nothing."""

    def searched(modes: tuple[Mode, ...], *, whole: bool = False) -> Solution:
        return records.searched(found.basis, found.delay_s, _known_rest(found.rest_fraction), modes, whole=whole)

    found = searched(found.modes)
    while found.modes:
        fewer = [searched(tuple(m for m in found.modes if m is not out)) for out in found.modes]
        least = min(fewer, key=lambda solution: solution.error)
        if MODE_PAYS * least.error**2 > found.error**2:
            break
        found = least
    if len(found.modes) == 1:
        ((_, f_Hz, zeta),) = found.modes
        whole = searched(((1.0, f_Hz, zeta),), whole=True)
        if MODE_PAYS * whole.error**2 < found.error**2:
            return whole
    return found


def _lagging(records: _Records, found: Solution) -> tuple[_Records, Solution]:
    """The same behind a low-pass in front of the operator, in the place of a part of the delay, where the records tell
    the two apart: an amplifier that charges the actuator, with all that lags like it.

    Without modes it is not looked for: records that show none do not tell a lag from the delay.
    """
    longest_s = min(records.lag_s, found.delay_s)
    if not found.modes or not longest_s > 0:
        return records, found
    without = _searched_from(records, found)
    behind, best = _best_lag(records, without, longest_s)
    # From there as well: what the search gained on its way has nothing to do with the lag.
    again = replace(best, delay_s=best.delay_s + behind.fits[0].lag_s)
    without = min(without, _searched_from(records, again), key=lambda one: one.error)
    rows = sum(effective_rows(without.residual(f)) for f in records.fits)
    shown = best.error > 0 and 2 * rows * np.log(without.error / best.error) > CHANCE_GAIN
    return (behind, best) if shown else (records, without)


def _best_lag(records: _Records, without: Solution, longest_s: float) -> tuple[_Records, Solution]:
    """Of all lags up to the longest the one that leaves least, and the best operator and modes behind it."""
    tried = {0.0: (records, without)}

    def error(at_s: float) -> float:
        lag_s = float(at_s)
        near_s = min(tried, key=lambda other_s: abs(other_s - lag_s))
        near, behind = tried[near_s][1], records.behind_a_lag(lag_s)
        start = replace(near, delay_s=max(near.delay_s + near_s - lag_s, 0.0))
        tried[lag_s] = behind, _searched_from(behind, start)
        return tried[lag_s][1].error

    bounds, step_s = (SHORTEST_LAG * longest_s, longest_s), LAG_STEP * longest_s
    minimize_scalar(error, bounds=bounds, method="bounded", options={"xatol": step_s})
    return min(tried.values(), key=lambda one: one[1].error)


def _searched_from(records: _Records, start: Solution) -> Solution:
    """The best operator and modes from there on; a single mode that carries all of the motion goes on to do so."""
    whole = [c for c, _, _ in start.modes] == [1.0]
    return records.searched(start.basis, start.delay_s, _known_rest(start.rest_fraction), start.modes, whole=whole)


def place_operator(runs: Sequence[AxisRun], known: OperatorFit, modes: tuple[Mode, ...]) -> OperatorFit:
    """Operator and modes fitted together from there on, thresholds where they are instead of on a grid; offsets of the
    records, and memories other than rest, stay as in ``known``.

    For records of many levels. Sines of one frequency cannot tell delay from play: theirs stays as it is.
    """
    if _one_frequency(runs):
        return known
    memories = [record.turned_V for record in known.records]
    records = _Records(
        runs, _thinned(runs, SEARCH_ROWS, ringing_s=ringing_s(modes), memories=memories), known.own_offsets
    )
    fading = len(known.fading_r_V) > 0
    fine, folds = records.basis(*FINEST, fading=fading), folds_of(records.fits)
    found = records.at(fine, known.view.delay_s, known.view.rest_fraction, modes)
    error, choice = np.inf, Choice(0, 0, np.inf)
    for _ in range(PLACED_TURNS):
        on_grid = records.at(fine, found.delay_s, found.rest_fraction, found.modes)
        plays = paired_plays(fine, on_grid.slopes)
        if fading and not 0 < plays.n_plays <= BESIDE_FADING:
            return known
        of_groups = centred(moments(records.fits, plays, found.delay_s, found.rest_fraction, found.modes))
        basis, choice = fewest_knots(plays, of_groups, folds)
        found = records.searched(
            basis, found.delay_s, _known_rest(found.rest_fraction), found.modes, whole=len(found.modes) == 1
        )
        if found.error > PLACED * error:
            break
        error = found.error
    records, found, messages = _told_behind_modes(records, _paying(records, found), known)
    rest = found.rest_fraction if _rest_matters(records, found.basis, found) else 0.0
    before = [replace(c, chosen=False) for c in known.choices]
    return _of_all_rows(records, replace(found, rest_fraction=rest), modes, (*before, choice), messages)


def _told_behind_modes(
    records: _Records, found: Solution, known: OperatorFit
) -> tuple[_Records, Solution, Sequence[str]]:
    """The memories told anew, since the ringing of fast records hid them from a fit without modes, and what to say of
    all of them.

    Where rows before those that count have settled a record there is no more to tell.
    """
    before, said = told_memories(records.fits), told_memories(records.fits)
    warmed = [i for i, f in enumerate(records.fits) if f.run.scored.start]
    rest, whole = _known_rest(found.rest_fraction), len(found.modes) == 1
    for turn in range(MEMORY_TURNS if found.modes else 0):
        share = OTHER_MEMORY if turn else LIKELY_MEMORY
        fits, said = with_memories(records.fits, found, share, records.own_offsets, known=warmed)
        if [f.turned_V for f in fits] == [f.turned_V for f in records.fits]:
            break
        records = replace(records, fits=fits)
        found = records.searched(found.basis, found.delay_s, rest, found.modes, whole=whole)
    return records, found, [*(line for line in known.messages if line not in before), *said]


def fit_linear(runs: Sequence[AxisRun], modes: tuple[Mode, ...] = (), lag_s: float | None = None) -> OperatorFit:
    """Gain and offset only, no memory and no delay. Raises BadInput for data that determine nothing.

    With a ``lag_s`` the gain is that of slow motion: lag, and the ``modes`` that pay, are fitted beside it.
    """
    fits = _thinned(runs, MOST_ROWS if lag_s is None else SEARCH_ROWS, ringing_s=ringing_s(modes))
    records = _Records(runs, fits, lag_s=lag_s or 0.0)
    basis = records.basis(0, 1)
    if lag_s is None:
        return _result(records, records.at(basis, 0.0, 0.0), (), ())
    found = _paying(records, Solution(basis, lag_s, 0.0, np.zeros(1), 0.0, 0.0, modes))
    full = replace(records, fits=_thinned(runs, MOST_ROWS))
    return _result(full, replace(found, delay_s=0.0, rest_fraction=0.0, modes=()), (), ())


def _thinned(
    runs: Sequence[AxisRun],
    most_rows: int,
    *,
    ringing_s: float = 0.0,
    memories: Sequence[Turns | None] | None = None,
) -> list[FitRun]:
    each = max(FEWEST_ROWS, most_rows // len(runs))
    blocks = 1 if len(runs) >= FOLD_BLOCKS else -(-FOLD_BLOCKS // len(runs))
    fits = [rows_to_fit(run, each, i * blocks, blocks, ringing_s=ringing_s) for i, run in enumerate(runs)]
    return fits if memories is None else [replace(f, turned_V=v) for f, v in zip(fits, memories, strict=True)]


def _rest_matters(records: _Records, basis: Basis, found: Solution) -> bool:
    errors = [records.at(basis, found.delay_s, r, found.modes).error for r in (found.rest_fraction, -0.9, 0.9)]
    return max(errors) > REST_MATTERS * errors[0]


def _one_frequency(runs: Sequence[AxisRun]) -> bool:
    sines = [run.sine for run in runs]
    found = [sine.f_Hz for sine in sines if sine is not None]
    return len(found) == len(runs) and max(found) < 1.5 * min(found)


def _shortest_delay_s(records: _Records, basis: Basis, delay_s: float, rest: float) -> float:
    """By bisection, to a thousandth of ``delay_s``."""
    allowed = SHORTER_DELAY * records.at(basis, delay_s, rest).error
    if records.at(basis, 0.0, rest).error <= allowed:
        return 0.0
    low, high = 0.0, delay_s
    for _ in range(10):
        middle = (low + high) / 2
        if records.at(basis, middle, rest).error > allowed:
            low = middle
        else:
            high = middle
    return high


def _choose_basis(records: _Records, found: Solution) -> tuple[Basis, tuple[Choice, ...]]:
    """The simplest basis that predicts left-out data as well as any, all else as found, and all that were tried."""
    fine = records.basis(*FINEST, fading=True)
    of_groups = centred(moments(records.fits, fine, found.delay_s, found.rest_fraction, found.modes))
    folds = folds_of(records.fits)
    choices, bases = [], []
    for stride, merge, fading in product(PLAY_STRIDES, SEGMENT_MERGES, (False, True)):
        if fading and not 0 < stride <= fine.n_plays <= stride * BESIDE_FADING:
            continue
        shrink, basis = _coarser(fine, stride, merge, fading=fading)
        error = left_out(shrink.T @ of_groups @ shrink, basis.n_segments, folds)
        choices.append(Choice(basis.n_plays, basis.n_segments, error, len(basis.fading_r_V)))
        bases.append(basis)
    least = min(c.left_out for c in choices)
    good = [i for i, c in enumerate(choices) if c.left_out <= SIMPLER * least]
    best = min(good, key=lambda i: (choices[i].size, choices[i].left_out))
    return bases[best], tuple(replace(c, chosen=i == best) for i, c in enumerate(choices))


def _coarser(fine: Basis, stride: int, merge: int, *, fading: bool) -> tuple[Samples, Basis]:
    """Every ``stride``-th play (0: none), ``merge`` segments in one, and the fading plays or none of them; and the
    matrix that shrinks the moments."""
    joined = np.kron(np.eye(fine.n_segments // merge), np.ones((merge, 1)))
    kept = np.eye(fine.n_plays)[:, stride - 1 :: stride] if stride else np.zeros((fine.n_plays, 0))
    faded = np.eye(len(fine.fading_r_V))[:, : None if fading else 0]
    shrink = block_diag(joined, kept, faded, np.eye(2))
    return shrink, Basis(fine.play_r_V @ kept, fine.knots_V[::merge], fine.fading_r_V @ faded)


def _of_all_rows(
    records: _Records, found: Solution, modes: tuple[Mode, ...], choices: Sequence[Choice], messages: Sequence[str]
) -> OperatorFit:
    """The result where a search on fewer rows ended that began with these ``modes``."""
    memories = [f.turned_V for f in records.fits]
    fits = _thinned(records.runs, MOST_ROWS, ringing_s=ringing_s(modes), memories=memories)
    full = replace(records, fits=fits).behind_a_lag(records.fits[0].lag_s)
    best = full.at(found.basis, found.delay_s, found.rest_fraction, found.modes)
    return _result(full, likeliest_slopes(full.fits, best, full.own_offsets), choices, messages)


def _result(records: _Records, solution: Solution, choices: Sequence[Choice], messages: Sequence[str]) -> OperatorFit:
    fits = records.fits
    residuals = [solution.residual(f) for f in fits]
    if records.own_offsets:
        at_rest_um = solution.at_rest_um + float(np.median([e.mean() for e in residuals]))
        solution = replace(solution, at_rest_um=at_rest_um)
        residuals = [solution.residual(f) for f in fits]
    unexplained = [e - e.mean() for e in residuals] if records.own_offsets else residuals
    return OperatorFit(
        solution.time_view(1.0 / fits[0].run.step_s, unexplained),
        standard_errors(fits, solution, residuals),
        tuple(RecordResidual.of(f, e, own_offset=records.own_offsets) for f, e in zip(fits, residuals, strict=True)),
        tuple(choices),
        tuple(messages),
        sum(effective_rows(e) for e in residuals),
        records.own_offsets,
        solution.modes,
        fits[0].lag_s,
        0.0,
        *solution.fading(),
    )
