"""A zero that moved between the reference session and the later ones, at once or steadily.

The search compares every record about its own offset and so cannot see this. Here the offsets themselves are the data,
one number per record: a step after the reference session, a drift that begins with it, or both. A step beyond which the
records go on to drift is no name for itself: a quick warming begins like one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as t_distribution

from phaselead.gap.error_rates import ERROR_RATE, FOUND, TWO_SIDED_95
from phaselead.identify import effective_rows
from phaselead.model import catalogue
from phaselead.record import Samples

LEAST_SHIFT = 5.0
"""Smallest shift that counts, in units of the scatter of single records, and of what is unexplained of them."""
DISTINCT = 2.0
"""Ratio of squared residuals from which a step and a drift can be told apart."""
AT_REST = 0.2
"""Share of the shift by which records at rest may differ from it, and of a drift at which they may move back."""
FEWEST = 3
"""Driven records of a session from which its scatter can be told."""


@dataclass(frozen=True)
class RecordOffset:
    """Where one record stands: its mean residual (um), at the middle of its time; ``idle`` where nothing was driven."""

    t_s: float
    mean_um: float
    idle: bool = False
    rate_um_per_s: float = 0.0
    """At which its residual moves, along a straight line."""
    rate_std_um_per_s: float = math.inf
    """Standard error of that; infinite where it is not known."""

    @classmethod
    def of(cls, t_s: Samples, error_um: Samples, idle: bool) -> RecordOffset:
        """Of a record's times and residual, (n,) each, of four rows at least. Only of one at rest is the rate asked."""
        at = cls(float(t_s.mean()), float(error_um.mean()), idle)
        if not idle:
            return at
        rate, std = _rate(t_s, error_um)
        half = len(t_s) // 2
        first, last = (_rate(t_s[part], error_um[part])[0] for part in (slice(None, half), slice(half, None)))
        # Slow noise looks like a straight line, and not like the same one in both halves.
        return replace(at, rate_um_per_s=rate, rate_std_um_per_s=math.hypot(std, (last - first) / 2))


def _rate(t_s: Samples, error_um: Samples) -> tuple[float, float]:
    """Slope of a straight line through a residual (n,) in um/s, and its standard error where noise is quick."""
    about = t_s - t_s.mean()
    rate = float(about @ error_um / (about @ about))
    left = error_um - error_um.mean() - rate * about
    return rate, float(np.sqrt(np.mean(left**2) * len(left) / effective_rows(left) / (about @ about)))


Course = Callable[[RecordOffset], float]
"""What multiplies an amount at a later record."""


@dataclass(frozen=True)
class Shift:
    """A step of the zero (um) or a drift of it (um/s), with the half-width of its 95 % interval, widened by how far
    records at rest differ from driven ones."""

    amount: float
    half: float
    sure: bool
    """Whether it is beyond chance, found again in held-out records and shown by records at rest as well."""
    left_um2: float
    """Sum of squares that remains of the offsets."""
    chance: float
    """Probability of as much by chance."""
    refuted: bool = False
    """Whether it would be sure, but records at rest move back."""
    not_at_rest: bool = False
    """Whether it would be sure, but records at rest stand elsewhere."""
    upper: float = 0.0
    """Largest magnitude that it may have; where records at rest stand elsewhere, they may be right."""


def session_shifts(
    reference: Sequence[RecordOffset],
    train: Sequence[RecordOffset],
    holdout: Sequence[RecordOffset],
    unexplained_um: float = 0.0,
    *,
    none_drifts: bool = False,
) -> Mapping[str, Shift]:
    """A step and a drift, each by the name of the effect it would be. A drift that goes on beyond any step refutes the
    step by itself; where the search has found that none goes on within a session (``none_drifts``), only one that is
    sure. What is unexplained of the records about their means, rms, may shift these too.

    Empty where the records do not suffice: driven ones of both sessions, and ones at rest of both, since anything that
    changes how the stage answers shifts the driven ones alone.
    """
    every = [list(reference), list(train), list(holdout)]
    before, learned, held = ([r for r in part if not r.idle] for part in every)
    at_rest = [r for r in every[0] if r.idle], [r for part in every[1:] for r in part if r.idle]
    if min(len(before), len(learned)) < FEWEST or not (held and at_rest[0] and at_rest[1]):
        return {}
    later, began_s = [*learned, *held], max(r.t_s for r in before)
    names = {e.moves_zero: e.name for e in catalogue().values() if e.moves_zero is not None}
    step, drift = names["at once"], names["steadily"]
    after = min(r.t_s for r in later) > began_s
    columns = [_stepped, _drifted(began_s)] if after else [_stepped]
    amounts, _, scatter, _ = _fitted(before, later, columns)
    # What fits badly is not for that as far off as it likes in records at rest, unless both together are seen there.
    tolerated = None if _seen_at_rest(amounts, columns, at_rest, scatter) else scatter
    found = {step: _shift(before, later, held, at_rest, None, unexplained_um, tolerated)}
    if not after:
        return found
    alone, beyond = (
        _shift(before, later, held, at_rest, began_s, unexplained_um, tolerated, beyond_step=b) for b in (False, True)
    )
    found[drift] = alone
    goes_on = beyond.sure or (beyond.chance < ERROR_RATE and not none_drifts)
    if goes_on and not (alone.sure and alone.left_um2 <= DISTINCT * beyond.left_um2):
        # Not a step alone; which of the two there is, or both, only a sure drift tells.
        back, stepped = _moves_back(beyond.amount, at_rest), found[step].sure
        sure = (alone.sure or stepped or beyond.sure) and not back
        found[step] = replace(found[step], sure=stepped and not (beyond.sure or back), refuted=stepped and back)
        refuted = (alone.refuted or beyond.refuted) and not sure
        found[drift] = replace(beyond, sure=sure, left_um2=found[step].left_um2, refuted=refuted)
    return found


def best_explained(shifts: Mapping[str, Shift]) -> tuple[str, ...]:
    """Name of the shift that is sure: both where step and drift cannot be told apart, none where neither is sure."""
    sure = sorted((name for name, shift in shifts.items() if shift.sure), key=lambda name: shifts[name].left_um2)
    if not sure:
        return ()
    best = shifts[sure[0]].left_um2
    return tuple(name for name in sure if shifts[name].left_um2 <= DISTINCT * best)


def _shift(
    before: Sequence[RecordOffset],
    later: Sequence[RecordOffset],
    held: Sequence[RecordOffset],
    at_rest: tuple[Sequence[RecordOffset], Sequence[RecordOffset]],
    began_s: float | None,
    unexplained_um: float,
    tolerated_um: float | None,
    *,
    beyond_step: bool = False,
) -> Shift:
    """The shift of ``later`` records against those ``before``: a drift from ``began_s`` on, or a step where None.
    ``tolerated_um``: scatter that records at rest may have about it; None is its own.

    ``at_rest`` are the records at rest before and later, which must stand off as far, and must not move back where it
    is a drift. ``beyond_step``: the drift beside a step of any size.
    """
    columns: list[Course] = [_stepped if began_s is None else _drifted(began_s), *([_stepped] if beyond_step else [])]
    amounts, error, scatter, p = _fitted(before, later, columns)
    again, _, _, p_again = _fitted(before, held, columns)
    moved = [abs(amounts[0] * columns[0](r)) for r in later]
    reach = max(moved) - (min(moved) if beyond_step else 0.0)
    tolerated_um = scatter if tolerated_um is None else tolerated_um
    seen_at_rest = _seen_at_rest(amounts, columns, at_rest, tolerated_um)
    found_again = bool(p_again < ERROR_RATE and amounts[0] * again[0] > 0)
    moved_surely = p < FOUND and found_again and reach > LEAST_SHIFT * max(scatter, unexplained_um)
    sure = seen_at_rest and moved_surely
    freedom = max(len(before) + len(later) - 1 - len(columns), 1)
    half = float(t_distribution.isf(0.025, freedom)) * error + _aside(
        amounts, columns, before, later, at_rest, tolerated_um
    )
    back = began_s is not None and _moves_back(amounts[0], at_rest)
    upper = abs(amounts[0]) + half
    if began_s is None and moved_surely and not seen_at_rest:
        upper = max(upper, float(np.max(np.abs(_stood_off(at_rest)))) + 3 * scatter)
    return Shift(
        amounts[0], half, sure and not back, scatter**2 * freedom, p, refuted=sure and back,
        not_at_rest=moved_surely and not seen_at_rest, upper=upper,
    )  # fmt: skip


def _seen_at_rest(
    amounts: Sequence[float],
    columns: Sequence[Course],
    at_rest: tuple[Sequence[RecordOffset], Sequence[RecordOffset]],
    scatter_um: float,
) -> bool:
    """Whether the later records at rest stand off as far as these amounts say."""
    expected = _expected(amounts, columns, at_rest[1])
    aside = np.abs(_stood_off(at_rest) - expected)
    return bool(np.all(aside < np.hypot(AT_REST * expected, 3 * scatter_um)))


def _expected(amounts: Sequence[float], columns: Sequence[Course], later: Sequence[RecordOffset]) -> Samples:
    """By how much (n,) later records stand off by so much of each course."""
    return np.array([sum(a * course(r) for a, course in zip(amounts, columns, strict=True)) for r in later])


def _stood_off(at_rest: tuple[Sequence[RecordOffset], Sequence[RecordOffset]]) -> Samples:
    """By how much (n,) the later records at rest stand off from those before."""
    before, later = at_rest
    return np.array([r.mean_um for r in later]) - float(np.mean([r.mean_um for r in before]))


def _aside(
    amounts: Sequence[float],
    columns: Sequence[Course],
    before: Sequence[RecordOffset],
    later: Sequence[RecordOffset],
    at_rest: tuple[Sequence[RecordOffset], Sequence[RecordOffset]],
    scatter: float,
) -> float:
    """How far the amount that driven records show may be off, since they stand off from those at rest, beyond the
    scatter of single records: what is missed of how the stage answers shifts all alike that are driven alike."""
    was, now = at_rest
    aside_um = float(np.mean(_stood_off(at_rest) - _expected(amounts, columns, now)))
    error_um = scatter * math.sqrt(1 / len(now) + 1 / len(was))
    all_later = np.concatenate([np.zeros(len(before)), np.ones(len(later))])
    of_one_um, *_ = np.linalg.lstsq(_design(before, later, columns), all_later, rcond=None)
    surely_apart = abs(aside_um) > TWO_SIDED_95 * error_um
    if surely_apart:  # either may be right: as far as the interval of those at rest
        off_um = abs(aside_um) + TWO_SIDED_95 * error_um
    else:
        off_um = math.sqrt(max(aside_um**2 - error_um**2, 0.0))
    return off_um * abs(float(of_one_um[1]))


def _moves_back(rate_um_per_s: float, at_rest: tuple[Sequence[RecordOffset], Sequence[RecordOffset]]) -> bool:
    """Whether later records at rest move against a drift, as those before did not: what creeps back in every session is
    no part of it."""
    before, later = at_rest
    rate = float(np.mean([r.rate_um_per_s for r in later]))
    told = [r.rate_std_um_per_s for r in later] + [math.hypot(r.rate_um_per_s, r.rate_std_um_per_s) for r in before]
    error = float(np.sqrt(np.mean(np.square(told))))
    back = -rate if rate_um_per_s > 0 else rate
    return back > 3 * error + AT_REST * abs(rate_um_per_s)


def _stepped(record: RecordOffset) -> float:
    """What multiplies a step at a later record."""
    return 1.0


def _drifted(began_s: float) -> Course:
    """What multiplies a drift from ``began_s`` on at a later record: the seconds since."""
    return lambda record: record.t_s - began_s


def _design(before: Sequence[RecordOffset], after: Sequence[RecordOffset], columns: Sequence[Course]) -> Samples:
    """A column of ones and one for each course, (records, 1 + courses); before there is none of them."""
    courses = [[0.0] * len(before) + [course(r) for r in after] for course in columns]
    return np.stack([np.ones(len(before) + len(after)), *map(np.array, courses)], axis=1)


def _fitted(
    before: Sequence[RecordOffset], after: Sequence[RecordOffset], columns: Sequence[Course]
) -> tuple[list[float], float, float, float]:
    """Amount of each course, and of the first its standard error, the scatter of the records about the fit, and the
    probability of as much by chance."""
    design = _design(before, after, columns)
    y = np.array([r.mean_um for r in (*before, *after)])
    amounts, *_ = np.linalg.lstsq(design, y, rcond=None)
    freedom = max(len(y) - design.shape[1], 1)
    scatter = float(np.sqrt(np.sum((y - design @ amounts) ** 2) / freedom))
    error = scatter * float(np.sqrt(np.linalg.pinv(design.T @ design)[1, 1]))
    p = 2 * float(t_distribution.sf(abs(amounts[1]) / max(error, 1e-15), freedom))
    return amounts[1:].tolist(), error, scatter, p
