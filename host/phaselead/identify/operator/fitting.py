"""Fits of the time view to records of one axis: reversible slopes, plays, delay, offset, memory, and modes behind it.

How many plays and segments the records carry is decided on data left out; a mode stays where it pays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from phaselead.identify.operator.choosing import FINEST, choose_basis
from phaselead.identify.operator.leaving_out import folds_of
from phaselead.identify.operator.likeliest import likeliest_slopes
from phaselead.identify.operator.placing import fewest_knots, paired_plays
from phaselead.identify.operator.records import Records, known_rest, searched_from, thinned
from phaselead.identify.operator.regressors import Basis, fitted_span_V, ringing_s
from phaselead.identify.operator.result import Choice, OperatorFit, RecordResidual, effective_rows, standard_errors
from phaselead.identify.operator.session import SEARCH_ROWS, as_known, from_their_memories, told_behind_modes
from phaselead.identify.operator.solution import CHANCE_GAIN, DRIFT, PART_PAYS, Solution, centred, moments, strayed
from phaselead.identify.operator.uneven import unevenly
from phaselead.identify.runs import AxisRun, one_frequency
from phaselead.model import Mode

MOST_ROWS = 30_000
"""Of all records, for the result."""
SHORTER_DELAY = 1.05
"""On records of one frequency a delay looks like more play: the shortest is taken that costs at most this factor."""
REST_MATTERS = 1.001
"""The memory at rest is known when other rest fractions cost more than this factor in error."""
PLACED_TURNS, PLACED = 3, 0.98
"""How often thresholds are placed anew, at the delay and the modes that go with those of before; done when the error
stays above this share of what it was."""

OWN_OFFSETS = f"the records differ in offset by more than {100 * DRIFT:g} % of their range: each has its own"
REST_UNTOLD = "the records do not tell how the memory rests at 0 V: it is taken as 0"
NO_REST = (
    "no record begins at rest at 0 V: rest fraction and offset follow from what is thought to have been before, and "
    "have no known error; give one that begins there"
)
LAG_STEP = 0.001
"""Of the longest lag: how finely the best one is searched. A hundredth was several standard errors."""
SHORTEST_LAG = 0.02
"""Of the longest lag. What the operator misses of a stage without a lag looks like a short one, 2.5 of 400 us at most
(a stage with two modes, late by one row, four draws of the noise), and a lag of up to twice that would gain as well."""


def fit_operator(runs: Sequence[AxisRun], modes: tuple[Mode, ...] = (), lag_s: float = 0.0) -> OperatorFit:
    """Fit the time view to one axis of one or more records, each from rest or warmed by the rows before its window.

    ``modes``: about where the mechanics have some; those that pay are fitted together with the operator. ``lag_s``:
    what else the measured response lags. Raises BadInput for data that determine nothing.
    """
    fits = thinned(runs, SEARCH_ROWS, ringing_s=ringing_s(modes))
    records = Records(runs, fits, fitted_span_V(runs, ringing_s(modes)), lag_s=lag_s)
    even, of_even, about_memories = from_their_memories(records, modes)
    records, found = even, of_even
    basis, choices = choose_basis(records, found)
    for fading in (len(basis.fading_r_V) > 0, True):
        uneven = unevenly(even, of_even, fading=fading)
        if uneven is not even:
            records, found, about_memories = from_their_memories(uneven, modes)
            basis, choices = choose_basis(records, found)
        if fading or not len(basis.fading_r_V):  # what fades may show only once the operator is as uneven as it is
            break
    if not basis.equals(found.basis):
        found = records.searched(basis, found.delay_s, found.rest_fraction, found.modes)
        basis, choices = choose_basis(records, found)
    lag_share = 0.0
    if modes:
        found = _paying(records, replace(found, basis=basis), modes)
        basis, choices = choose_basis(records, found)
        without = records.at(basis, found.delay_s, found.rest_fraction, found.modes)
        records, found = _lagging(records, without)
        basis, choices = choose_basis(records, found)
        lag_share = 1 - (found.error / without.error) ** 2 if records.fits[0].lag_s else 0.0
    messages = [OWN_OFFSETS] if records.own_offsets else []
    delay_s, rest = found.delay_s, found.rest_fraction
    if not _rest_matters(records, basis, found):
        rest = 0.0
        messages.append(REST_UNTOLD)
    if one_frequency(runs):
        delay_s = _shortest_delay_s(records, basis, delay_s, rest)
        messages.append("one frequency cannot tell delay from play: the shortest delay that fits was taken")
    found = replace(found, basis=basis, delay_s=delay_s, rest_fraction=rest)
    whole = _of_all_rows(records, found, modes, choices, [*about_memories, *messages])
    return replace(whole, lag_share=lag_share, about_memories=tuple(about_memories))


def _paying(records: Records, found: Solution, began: tuple[Mode, ...]) -> Solution:
    """The operator without the modes that strayed from where their search ``began`` or that do not pay, and with all of
    the motion carried by the only one if that costs nothing."""

    def searched(modes: tuple[Mode, ...], *, whole: bool = False) -> Solution:
        return records.searched(found.basis, found.delay_s, known_rest(found.rest_fraction), modes, whole=whole)

    found = searched(found.modes)
    while (out := strayed(found.modes, began)) is not None:
        began = began[:out] + began[out + 1 :]
        found = searched(began)
    while found.modes:
        fewer = [searched(tuple(m for m in found.modes if m is not out)) for out in found.modes]
        least = min(fewer, key=lambda solution: solution.error)
        if PART_PAYS * least.error**2 > found.error**2:
            break
        found = least
    if len(found.modes) == 1:
        ((_, f_Hz, zeta),) = found.modes
        whole = searched(((1.0, f_Hz, zeta),), whole=True)
        if PART_PAYS * whole.error**2 < found.error**2:
            return whole
    return found


def _lagging(records: Records, found: Solution) -> tuple[Records, Solution]:
    """The same behind a low-pass in front of the operator, in the place of a part of the delay, where the records tell
    the two apart, so that its interval does not hold 0: an amplifier that charges the actuator, with all that lags like
    it.

    Without modes it is not looked for: records that show none do not tell a lag from the delay.
    """
    longest_s = min(records.lag_s, found.delay_s)
    if not found.modes or not longest_s > 0:
        return records, found
    without = searched_from(records, found)
    behind, best = _best_lag(records, without, longest_s)
    # From there as well: what the search gained on its way has nothing to do with the lag.
    again = replace(best, delay_s=best.delay_s + behind.fits[0].lag_s)
    without = min(without, searched_from(records, again), key=lambda one: one.error)
    rows = sum(effective_rows(without.residual(f)) for f in records.fits)
    shown = best.error > 0 and 2 * rows * np.log(without.error / best.error) > CHANCE_GAIN
    return (behind, best) if shown and _lag_told(behind, best) else (records, without)


def _lag_told(behind: Records, found: Solution) -> bool:
    """Whether the 95 % interval of the lag is known and does not hold 0."""
    interval_s = _of_all_rows(behind, found, found.modes, (), ()).lag_ci95_s
    return interval_s is not None and interval_s[0] > 0


def _best_lag(records: Records, without: Solution, longest_s: float) -> tuple[Records, Solution]:
    """Of all lags up to the longest the one that leaves least, and the best operator and modes behind it."""
    tried = {0.0: (records, without)}

    def error(at_s: float) -> float:
        lag_s = float(at_s)
        near_s = min(tried, key=lambda other_s: abs(other_s - lag_s))
        near, behind = tried[near_s][1], records.behind_a_lag(lag_s)
        start = replace(near, delay_s=max(near.delay_s + near_s - lag_s, 0.0))
        tried[lag_s] = behind, searched_from(behind, start)
        return tried[lag_s][1].error

    bounds, step_s = (SHORTEST_LAG * longest_s, longest_s), LAG_STEP * longest_s
    minimize_scalar(error, bounds=bounds, method="bounded", options={"xatol": step_s})
    return min(tried.values(), key=lambda one: one[1].error)


def place_operator(runs: Sequence[AxisRun], known: OperatorFit, modes: tuple[Mode, ...]) -> OperatorFit:
    """Operator and modes fitted together from there on, thresholds where they are instead of on a grid; whether
    records have offsets of their own stays as in ``known``.

    For records of many levels. Sines of one frequency cannot tell delay from play: theirs stays as it is.
    """
    if one_frequency(runs):
        return known
    records = as_known(runs, known, modes)
    fading = len(known.fading_r_V) > 0
    fine, folds = records.basis(*FINEST, fading=fading), folds_of(records.fits)
    found = records.at(fine, known.view.delay_s, known.view.rest_fraction, modes)
    error, choice = np.inf, Choice(0, 0, np.inf)
    for _ in range(PLACED_TURNS):
        on_grid = records.at(fine, found.delay_s, found.rest_fraction, found.modes)
        plays = paired_plays(fine, on_grid.slopes)
        if fading and not plays.n_plays:
            return known
        of_groups = centred(moments(records.fits, plays, found.delay_s, found.rest_fraction, found.modes))
        basis, choice = fewest_knots(plays, of_groups, folds)
        found = records.searched(
            basis, found.delay_s, known_rest(found.rest_fraction), found.modes, whole=len(found.modes) == 1
        )
        if found.error > PLACED * error:
            break
        error = found.error
    records, found, about_memories = told_behind_modes(records, _paying(records, found, modes), known)
    if known.lag_s and not found.modes:  # without modes nothing tells a lag from the delay
        return known
    rest_told = _rest_matters(records, found.basis, found)
    others = [line for line in known.messages if line not in (*known.about_memories, REST_UNTOLD, NO_REST)]
    messages = [*others, *about_memories, *([] if rest_told else [REST_UNTOLD])]
    rest = found.rest_fraction if rest_told else 0.0
    before = [replace(c, chosen=False) for c in known.choices]
    placed = _of_all_rows(records, replace(found, rest_fraction=rest), modes, (*before, choice), messages)
    return replace(placed, lag_share=known.lag_share, about_memories=tuple(about_memories))


def fit_linear(runs: Sequence[AxisRun], modes: tuple[Mode, ...] = (), lag_s: float | None = None) -> OperatorFit:
    """Gain and offset only, no memory and no delay. Raises BadInput for data that determine nothing.

    With a ``lag_s`` the gain is that of slow motion: lag, and the ``modes`` that pay, are fitted beside it.
    """
    fits = thinned(runs, MOST_ROWS if lag_s is None else SEARCH_ROWS, ringing_s=ringing_s(modes))
    records = Records(runs, fits, fitted_span_V(runs, ringing_s(modes)), lag_s=lag_s or 0.0)
    basis = records.basis(0, 1)
    if lag_s is None:
        return _result(records, records.at(basis, 0.0, 0.0), (), ())
    found = _paying(records, Solution(basis, lag_s, 0.0, np.zeros(1), 0.0, 0.0, modes), modes)
    full = replace(records, fits=thinned(runs, MOST_ROWS), span_V=fitted_span_V(runs))
    return _result(full, replace(found, delay_s=0.0, rest_fraction=0.0, modes=()), (), ())


def _rest_matters(records: Records, basis: Basis, found: Solution) -> bool:
    errors = [records.at(basis, found.delay_s, r, found.modes).error for r in (found.rest_fraction, -0.9, 0.9)]
    return max(errors) > REST_MATTERS * errors[0]


def _shortest_delay_s(records: Records, basis: Basis, delay_s: float, rest: float) -> float:
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


def _of_all_rows(
    records: Records, found: Solution, modes: tuple[Mode, ...], choices: Sequence[Choice], messages: Sequence[str]
) -> OperatorFit:
    """The result where a search on fewer rows ended that began with these ``modes``."""
    memories = [f.turned_V for f in records.fits]
    fits = thinned(records.runs, MOST_ROWS, ringing_s=ringing_s(modes), memories=memories)
    full = replace(records, fits=fits).behind_a_lag(records.fits[0].lag_s).in_field(records.field.bend)
    best = full.at(found.basis, found.delay_s, found.rest_fraction, found.modes)
    return _result(full, likeliest_slopes(full.fits, best, full.offset_weight), choices, messages)


def _result(records: Records, solution: Solution, choices: Sequence[Choice], messages: Sequence[str]) -> OperatorFit:
    fits = records.fits
    residuals = [solution.residual(f) for f in fits]
    if records.own_offsets:
        at_rest_um = solution.at_rest_um + float(np.median([e.mean() for e in residuals]))
        solution = replace(solution, at_rest_um=at_rest_um)
        residuals = [solution.residual(f) for f in fits]
    unexplained = [e - e.mean() for e in residuals] if records.own_offsets else residuals
    view = solution.time_view(1.0 / fits[0].run.step_s, unexplained)
    std = standard_errors(fits, solution, residuals)
    remembers = solution.basis.size > solution.basis.n_segments and REST_UNTOLD not in messages
    rested = not remembers or any(f.turned_V is None and f.run.begins_at_0_V for f in fits)
    return OperatorFit(
        view.model_copy(update={"u_range_V": records.span_V, "field_bend": records.field.bend}),
        std if rested else std | {"rest_fraction": (float("nan"),), "offset_um": (float("nan"),)},
        tuple(RecordResidual.of(f, e, own_offset=records.own_offsets) for f, e in zip(fits, residuals, strict=True)),
        tuple(choices),
        (*messages, *([] if rested else [NO_REST])),
        sum(effective_rows(e) for e in residuals),
        records.own_offsets,
        solution.modes,
        fits[0].lag_s,
        0.0,
        *solution.fading(),
    )
