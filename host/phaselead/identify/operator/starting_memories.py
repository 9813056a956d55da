"""Where the memory of a record starts: at rest, or after the turns that the stage made before it.

Once a record has been at both ends of its voltage, nothing that it can still move remembers what was before it
(wiping-out); what is left of the past is an offset. So slopes come from settled rows first, and the starting memories
are told apart afterwards, by the rows before.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from phaselead.identify.operator.regressors import FitRun, Turns
from phaselead.identify.operator.solution import DRIFT, EXACT
from phaselead.identify.runs import AxisRun
from phaselead.record import Samples

OTHER_MEMORY, LIKELY_MEMORY = 0.6, 0.8
"""A record starts from another memory than rest when that leaves less than the first share of its squared residual. An
operator that was fitted to rest hides that: below the second the memory is tried, and the operator that goes with it
tells."""
ALIKE = 0.99
"""Of a squared residual, chosen: a turn is moved off its grid where that leaves less than this, and ways that leave no
more beside one another are alike."""
PRECISE = 0.02
"""Of the way between the points on either side of a turn: how finely the best one is searched."""
FEW_WAYS = 10
"""So many ways before a record are made longer, the best ones: a budget of time."""
END_SHARE = 0.01
"""Of the span: this close to the end of its voltage a record has been there."""
ENOUGH_ROWS = 1 / 3
"""Of the rows: where no record has so many settled ones, all are used whole."""
FEWEST_SETTLED = 20
"""Rows of a record at least, chosen: enough for an offset, too few to draw the operator."""
MOST_TURNS = 4
"""Before a record: a loop through both ends, and a way to where the record begins that turns round once more or
twice."""
NAMED_RECORDS = 3
"""How many records a message names."""


def starting_memory(
    squares: Callable[[Turns | None], float], turning_points_V: Iterable[float], share: float = LIKELY_MEMORY
) -> Turns | None:
    """The one voltage at which the stage turned round before a record, or None when it starts from rest.

    ``squares`` gives the squared residual of the record for turning points in V, and for None from rest. The turning
    point that leaves least is believed when it leaves less than ``share`` of what rest leaves.
    """
    best = min(((volt,) for volt in turning_points_V), key=squares, default=None)
    return best if best is not None and squares(best) < share * squares(None) else None


def way_before(
    squares: Callable[[Turns | None], float],
    turning_points_V: Sequence[float],
    first_V: float,
    share: float = LIKELY_MEMORY,
    about: Callable[[Turns], float] | None = None,
) -> Turns | None:
    """The voltages at which the stage turned round before a record that begins at ``first_V``: none where it had gone
    there straight, or None where it steps there from rest.

    As ``starting_memory``, with up to ``MOST_TURNS`` of them: each is believed when it leaves less than ``share`` of
    what is left without it. One more is tried beside the best few of each number, and beside the ends of the range,
    since of a loop and the way back neither explains much alone. ``about`` is a quicker way to about the same squares,
    to look for the best by.
    """
    straight: list[Turns | None] = [None, ()] if first_V else [None]
    found = min(straight, key=squares)
    left = squares(found)
    about, points_V = about or squares, _finer_near(first_V, turning_points_V)
    few: list[Turns] = [()]
    ends: list[Turns] = [(min(points_V),), (max(points_V),)]
    for count in range(1, MOST_TURNS + 1):
        # A scan of the whole range is what most records come after; each end alone may explain less than any turn.
        begun = [*few, *ends] if count == 2 else few
        longer = {more for turns in begun for more in _with_another(turns, points_V, first_V)}
        few = sorted(longer, key=lambda turns: (about(turns), *map(abs, turns)))[:FEW_WAYS]
        if not few:
            break
        best = _polished(about, few[0], points_V, first_V)
        gained = squares(best) < left * share ** (count - len(found or ()))
        if gained:
            found, left = best, squares(best)
        elif count > 1:
            break
    return found


def _finer_near(first_V: float, points_V: Sequence[float]) -> list[float]:
    """The points, and one halfway from the voltage to the next on either side: the last turns are close to it."""
    above = min((volt for volt in points_V if volt > first_V), default=first_V)
    below = max((volt for volt in points_V if volt < first_V), default=first_V)
    return sorted({*points_V, (first_V + above) / 2, (first_V + below) / 2})


def _with_another(turns: Turns, points_V: Sequence[float], first_V: float) -> Iterator[Turns]:
    """These turns with one of the points among them, where all are still remembered at ``first_V``."""
    for at in range(len(turns) + 1):
        for volt in points_V:
            more = (*turns[:at], volt, *turns[at:])
            if _remembered(more, first_V):
                yield more


def _remembered(turns: Turns, first_V: float) -> bool:
    """Whether none of these turns has wiped out another: they close in on the voltage, from one side and the other."""
    ways = [to - start for start, to in pairwise((*turns, first_V))]
    return 0 not in ways and all(now * last < 0 and abs(now) < abs(last) for last, now in pairwise(ways))


def _polished(squares: Callable[[Turns], float], turns: Turns, points_V: Sequence[float], first_V: float) -> Turns:
    """The turns moved between the points next to them to where they leave least, one after the other."""
    for at in range(len(turns)):
        moved = _moved(squares, turns, at, points_V)
        if squares(moved) < ALIKE * squares(turns) and _remembered(moved, first_V):
            turns = moved
    return turns


def _moved(squares: Callable[[Turns], float], turns: Turns, at: int, points_V: Sequence[float]) -> Turns:
    """The turns with the one in place ``at`` where it leaves least between the points next to it."""

    def with_turn(volt: float) -> Turns:
        return (*turns[:at], float(volt), *turns[at + 1 :])

    low = max((volt for volt in points_V if volt < turns[at]), default=turns[at])
    high = min((volt for volt in points_V if volt > turns[at]), default=turns[at])
    options = {"xatol": PRECISE * (high - low)}
    found = minimize_scalar(
        lambda volt: squares(with_turn(volt)), bounds=(low, high), method="bounded", options=options
    )
    return with_turn(found.x)


def settled_of(fits: Sequence[FitRun]) -> list[FitRun]:
    """The records without the rows in which they still remember what was before them.

    A record that is never settled would draw the operator to a memory that nobody knows yet. It stands with its last
    rows, which remember least, for the others to tell where it began; where all are like that they stand whole.
    """
    if not some_settle(fits):
        return list(fits)
    return [_of_rows(fit, fit.rows >= _forgotten(fit)) for fit in fits]


def some_settle(fits: Sequence[FitRun]) -> bool:
    """Whether some record goes on long enough after it has forgotten what was before it. Where none does, records are
    used whole."""
    return any(_settles(fit) for fit in fits)


def _settles(fit: FitRun) -> bool:
    return bool(np.mean(fit.rows >= _forgotten(fit)) >= ENOUGH_ROWS)


def _forgotten(fit: FitRun) -> int:
    """The first row that remembers nothing of what was before the record but an offset."""
    u = fit.run.u_V
    slack = END_SHARE * np.ptp(u)
    return max(int(np.argmax(u >= u.max() - slack)), int(np.argmax(u <= u.min() + slack)))


def _of_rows(fit: FitRun, keep: NDArray[np.bool_]) -> FitRun:
    """The record with these rows, or with its last ones where these are too few to tell its offset."""
    if keep.sum() < FEWEST_SETTLED:
        keep = np.arange(len(keep)) >= len(keep) - FEWEST_SETTLED
    return replace(fit, rows=fit.rows[keep], groups=fit.groups[keep])


class Leaves(Protocol):
    """What a fitted operator leaves of a record (rows,) in um."""

    def residual(self, fit: FitRun) -> Samples:
        """From the memory that the record has."""

    def residuals_of(self, fit: FitRun) -> Callable[[Turns], Samples]:
        """About the same for any turns before it, quickly."""


def with_memories(
    fits: Sequence[FitRun],
    operator: Leaves,
    share: float,
    own_offsets: bool,
    known: Collection[int] = (),
) -> tuple[list[FitRun], list[str]]:
    """The records, each from the memory it starts from, and a message that names those not from rest: where one leaves
    less than ``share`` of what rest leaves.

    The mean of what the ``operator`` leaves of a record tells of the memory only beyond what creep and drift make, and
    not at all with ``own_offsets``. A single record defines what rest is. Those with the numbers ``known`` stay as they
    are.
    """
    if len(fits) < 2:
        return list(fits), []
    points_V = turning_points_V(fits)
    found = [fit if i in known else _with_memory(fit, operator, points_V, share, own_offsets)
             for i, fit in enumerate(fits)]  # fmt: skip
    return found, told_memories(found)


def _with_memory(fit: FitRun, operator: Leaves, points_V: Sequence[float], share: float, own_offset: bool) -> FitRun:
    whole = fit.with_start()
    quick = operator.residuals_of(whole)

    def squares(left_um: Samples) -> float:
        return float(np.var(left_um)) + (0.0 if own_offset else beyond_drift_um(left_um, fit.run) ** 2)

    @cache
    def surely(turned_V: Turns | None) -> float:
        return squares(operator.residual(replace(whole, turned_V=turned_V)))

    @cache
    def about(turned_V: Turns) -> float:
        return squares(quick(turned_V))

    turned_V = way_before(surely, points_V, fit.run.first_V, share, about)
    return replace(fit, turned_V=turned_V)


def beyond_drift_um(left_um: Samples, run: AxisRun) -> float:
    """How far what is left of a record stands off on average, beyond what creep and drift make."""
    return max(abs(float(left_um.mean())) - DRIFT * run.range_um, 0.0)


def with_alike_offsets(fits: Sequence[FitRun], operator: Leaves) -> list[FitRun]:
    """The records with their first turns moved to where their offsets are most alike.

    How far the first turn went is often nothing but an offset: with offsets of their own, rounding tells which of the
    ways that leave a record alike it is, and an operator of one offset for all bends for what they then differ by.
    """
    points_V = turning_points_V(fits)
    each = [ways_alike(fit, operator, points_V) for fit in fits]

    def spread(to_um: float) -> float:
        return sum((nearest(ways, to_um)[1] - to_um) ** 2 / ways[0][0].run.range_um ** 2 for ways in each)

    common_um = min((mean_um for ways in each for _, mean_um in ways), key=spread)
    return [nearest(ways, common_um)[0] for ways in each]


Ways = list[tuple[FitRun, float]]
"""A record after each way that leaves it alike, and what that leaves on average, in um."""


def nearest(ways: Ways, to_um: float) -> tuple[FitRun, float]:
    return min(ways, key=lambda one: abs(one[1] - to_um))


def ways_alike(
    fit: FitRun,
    operator: Leaves,
    points_V: Sequence[float],
    after: Callable[[Turns], Turns] = lambda turns: turns,
) -> Ways:
    """The ways that leave a record as the one that it has: that one, and with its first turn at each of the points, all
    of them first as they are ``after`` what was before. The one that the record has is among them."""
    whole = fit.with_start()
    if not fit.turned_V:
        return [(fit, float(operator.residual(whole).mean()))]
    quick, first_V = operator.residuals_of(whole), fit.run.first_V
    ways = [fit.turned_V, *((volt, *fit.turned_V[1:]) for volt in points_V)]
    remembered = [turns for turns in (*map(after, ways), *ways) if _remembered(turns, first_V)]
    left = {turns: quick(turns) for turns in (*remembered, fit.turned_V)}
    most = (float(np.var(left[fit.turned_V])) + (EXACT * fit.run.range_um) ** 2) / ALIKE
    return [(replace(fit, turned_V=turns), float(e.mean())) for turns, e in left.items() if np.var(e) <= most]


def told_memories(fits: Sequence[FitRun]) -> list[str]:
    """What is said of where these records start."""
    return _message([named(fit) for fit in fits if fit.turned_V], len(fits))


def named(fit: FitRun) -> str:
    ways = " and then ".join(f"{volt:.3g} V" for volt in fit.turned_V or ())
    return f"{fit.run.source} (from about {ways})" if ways else f"{fit.run.source} (straight from rest)"


def turning_points_V(fits: Sequence[FitRun]) -> list[float]:
    """Voltages a record can have come from: an even grid, and the ends of every record."""
    ends = [float(end) for f in fits for end in (f.run.u_V.min(), f.run.u_V.max())]
    low, high = min(ends), max(ends)
    grid = [*np.linspace(low, high, 9).tolist(), *sorted(ends)]
    spaced: list[float] = []
    for volt in sorted(grid):
        if not spaced or volt - spaced[-1] > 0.02 * (high - low):
            spaced.append(volt)
    return spaced


def _message(elsewhere: list[str], count: int) -> list[str]:
    if not elsewhere:
        return []
    return [
        f"{len(elsewhere)} of {count} records do not start from rest; where each began was searched for, record by "
        f"record: {some_of(elsewhere)}"
    ]


def some_of(names: list[str]) -> str:
    """The first of some names, and how many more there are."""
    more = f" and {len(names) - NAMED_RECORDS} more" if len(names) > NAMED_RECORDS else ""
    return f"{', '.join(names[:NAMED_RECORDS])}{more}"
