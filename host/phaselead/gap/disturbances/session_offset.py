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
    sessions = _Sessions(reference, train, holdout)
    if not sessions.suffice:
        return {}
    names = {e.moves_zero: e.name for e in catalogue().values() if e.moves_zero is not None}
    step, drift = names["at once"], names["steadily"]
    drifted = _drifted(sessions.began_s)
    in_turn = min(r.t_s for r in sessions.later) > sessions.began_s
    both = sessions.fitted([_stepped, drifted] if in_turn else [_stepped], sessions.later)
    # Where there are a step and a drift, either alone fits badly, and within its large scatter records at rest could
    # stand anywhere: they are allowed the scatter about both, unless they confirm both.
    allowed_um = None if sessions.seen_at_rest(both, both.scatter_um) else both.scatter_um
    found = {step: sessions.shift([_stepped], unexplained_um, allowed_um)}
    if not in_turn:
        return found
    alone, beyond = (sessions.shift(c, unexplained_um, allowed_um) for c in ([drifted], [drifted, _stepped]))
    found[drift] = alone
    goes_on = beyond.sure or (beyond.chance < ERROR_RATE and not none_drifts)
    if goes_on and not (alone.sure and alone.left_um2 <= DISTINCT * beyond.left_um2):
        # Not a step alone; which of the two there is, or both, only a sure drift tells.
        back, stepped = sessions.moves_back(beyond.amount), found[step].sure
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


def _stepped(record: RecordOffset) -> float:
    """What multiplies a step at a later record."""
    return 1.0


def _drifted(began_s: float) -> Course:
    """What multiplies a drift from ``began_s`` on at a later record: the seconds since."""
    return lambda record: record.t_s - began_s


@dataclass(frozen=True)
class _Fit:
    """Amounts of one course or two that driven records show. The error and the chance of as much are of the first."""

    courses: Sequence[Course]
    amounts: Sequence[float]
    error: float
    scatter_um: float
    """Of the records about the fit."""
    chance: float

    def moved_um(self, record: RecordOffset) -> float:
        """By how much a later record stands off."""
        return sum(a * course(record) for a, course in zip(self.amounts, self.courses, strict=True))


class _Sessions:
    """The records of the reference session and those of the later one, driven ones and those at rest."""

    def __init__(
        self, reference: Sequence[RecordOffset], train: Sequence[RecordOffset], holdout: Sequence[RecordOffset]
    ) -> None:
        (self.before, self.rest_before), (self.learned, rest), (self.held, more) = (
            ([r for r in part if not r.idle], [r for r in part if r.idle]) for part in (reference, train, holdout)
        )
        self.later, self.rest_later = [*self.learned, *self.held], [*rest, *more]

    @property
    def suffice(self) -> bool:
        """Whether there are driven records enough, and records at rest of both sessions."""
        enough = min(len(self.before), len(self.learned)) >= FEWEST
        return enough and bool(self.held and self.rest_before and self.rest_later)

    @property
    def began_s(self) -> float:
        """When a drift begins: at the last driven record of the reference session."""
        return max(r.t_s for r in self.before)

    def shift(self, courses: Sequence[Course], unexplained_um: float, allowed_um: float | None) -> Shift:
        """The step or the drift of the later records that the first of the courses is, beside the second if there is
        one. Records at rest must stand off as far, and must not move back where it is a drift; ``allowed_um``: scatter
        that they may have about it, None for its own.
        """
        fit, again = self.fitted(courses, self.later), self.fitted(courses, self.held)
        amount, drifts, beside = fit.amounts[0], courses[0] is not _stepped, len(courses) > 1
        moved = [abs(amount * courses[0](r)) for r in self.later]
        reach = max(moved) - (min(moved) if beside else 0.0)
        allowed_um = fit.scatter_um if allowed_um is None else allowed_um
        found_again = bool(again.chance < ERROR_RATE and amount * again.amounts[0] > 0)
        moved_surely = fit.chance < FOUND and found_again and reach > LEAST_SHIFT * max(fit.scatter_um, unexplained_um)
        seen_at_rest = self.seen_at_rest(fit, allowed_um)
        sure, elsewhere = moved_surely and seen_at_rest, moved_surely and not seen_at_rest
        freedom = max(len(self.before) + len(self.later) - 1 - len(courses), 1)
        half = float(t_distribution.isf(0.025, freedom)) * fit.error + self._aside(fit, allowed_um)
        upper = abs(amount) + half
        if elsewhere and not drifts:
            upper = max(upper, float(np.max(np.abs(self._stood_off()))) + 3 * fit.scatter_um)
        back = drifts and self.moves_back(amount)
        return Shift(
            amount, half, sure and not back, fit.scatter_um**2 * freedom, fit.chance, refuted=sure and back,
            not_at_rest=elsewhere, upper=upper,
        )  # fmt: skip

    def fitted(self, courses: Sequence[Course], after: Sequence[RecordOffset]) -> _Fit:
        """How far the driven records ``after`` stand off from those before."""
        design = self._design(courses, after)
        y = np.array([r.mean_um for r in (*self.before, *after)])
        amounts, *_ = np.linalg.lstsq(design, y, rcond=None)
        freedom = max(len(y) - design.shape[1], 1)
        scatter_um = float(np.sqrt(np.sum((y - design @ amounts) ** 2) / freedom))
        error = scatter_um * float(np.sqrt(np.linalg.pinv(design.T @ design)[1, 1]))
        chance = 2 * float(t_distribution.sf(abs(amounts[1]) / max(error, 1e-15), freedom))
        return _Fit(courses, amounts[1:].tolist(), error, scatter_um, chance)

    def _design(self, courses: Sequence[Course], after: Sequence[RecordOffset]) -> Samples:
        """A column of ones and one for each course, (records, 1 + courses); before there is none of them."""
        columns = [[0.0] * len(self.before) + [course(r) for r in after] for course in courses]
        return np.stack([np.ones(len(self.before) + len(after)), *map(np.array, columns)], axis=1)

    def _stood_off(self) -> Samples:
        """By how much (n,) the later records at rest stand off from those before."""
        return np.array([r.mean_um for r in self.rest_later]) - float(np.mean([r.mean_um for r in self.rest_before]))

    def seen_at_rest(self, fit: _Fit, scatter_um: float) -> bool:
        """Whether the later records at rest stand off as far as the driven ones say, within this scatter."""
        expected = np.array([fit.moved_um(r) for r in self.rest_later])
        aside = np.abs(self._stood_off() - expected)
        return bool(np.all(aside < np.hypot(AT_REST * expected, 3 * scatter_um)))

    def _aside(self, fit: _Fit, scatter_um: float) -> float:
        """How far the amount that driven records show may be off, since they stand off from those at rest, beyond the
        scatter of single records: what is missed of how the stage answers shifts all alike that are driven alike."""
        aside_um = float(np.mean(self._stood_off() - [fit.moved_um(r) for r in self.rest_later]))
        error_um = scatter_um * math.sqrt(1 / len(self.rest_later) + 1 / len(self.rest_before))
        all_later = np.concatenate([np.zeros(len(self.before)), np.ones(len(self.later))])
        of_one_um, *_ = np.linalg.lstsq(self._design(fit.courses, self.later), all_later, rcond=None)
        if abs(aside_um) > TWO_SIDED_95 * error_um:  # either may be right: as far as the interval of those at rest
            off_um = abs(aside_um) + TWO_SIDED_95 * error_um
        else:
            off_um = math.sqrt(max(aside_um**2 - error_um**2, 0.0))
        return off_um * abs(float(of_one_um[1]))

    def moves_back(self, rate_um_per_s: float) -> bool:
        """Whether later records at rest move against a drift, as those before did not: what creeps back in every
        session is no part of it."""
        rate = float(np.mean([r.rate_um_per_s for r in self.rest_later]))
        told = [r.rate_std_um_per_s for r in self.rest_later]
        told += [math.hypot(r.rate_um_per_s, r.rate_std_um_per_s) for r in self.rest_before]
        error = float(np.sqrt(np.mean(np.square(told))))
        back = -rate if rate_um_per_s > 0 else rate
        return back > 3 * error + AT_REST * abs(rate_um_per_s)
