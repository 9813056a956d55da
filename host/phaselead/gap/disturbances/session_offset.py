"""A zero that moved between the reference session and the later ones, at once or steadily.

The search compares every record about its own offset and so cannot see this. Here the offsets themselves are the data,
one number per record: a step after the reference session, a drift that begins with it, or both. A step beyond which the
records go on to drift is no name for itself: a quick warming begins like one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as t_distribution

from phaselead.gap.error_rates import ERROR_RATE, FOUND
from phaselead.identify import effective_rows
from phaselead.model import catalogue
from phaselead.record import Samples

LEAST_SHIFT = 5.0
"""Smallest shift that counts, in units of the scatter of single records, and of what is unexplained of them."""
DISTINCT = 2.0
"""Ratio of squared residuals from which a step and a drift can be told apart."""
AT_REST = 0.2
"""Share of the shift by which records at rest may differ from it."""
SLOWEST = 0.15
"""Share of its mean rate at which a drift goes on at least in a record at rest: a stage that warms up is as slow after
three time constants, when 95 % of it are over."""
FEWEST = 3
"""Driven records of a session from which its scatter can be told."""


@dataclass(frozen=True)
class RecordOffset:
    """Mean residual (um) of one record, at the middle of its time; ``idle`` where nothing was driven."""

    t_s: float
    mean_um: float
    idle: bool = False
    seconds: float = 0.0
    """How long it is."""
    moved_um: float = 0.0
    """By how much its residual goes up from its begin to its end, along a straight line."""
    moved_std_um: float = 0.0
    """How surely that is told."""

    @classmethod
    def of(cls, t_s: Samples, error_um: Samples, idle: bool) -> RecordOffset:
        """Of a record's times and residual, (n,) each."""
        seconds, about = float(t_s[-1] - t_s[0]), t_s - t_s.mean()
        squares = max(float(about @ about), 1e-30)
        slope = float(about @ error_um) / squares
        left = error_um - error_um.mean() - slope * about
        std = float(np.sqrt(np.mean(left**2) * len(left) / effective_rows(left) / squares))
        return cls(float(t_s.mean()), float(error_um.mean()), idle, seconds, slope * seconds, std * seconds)

    def may_drift_at(self, rate_um_per_s: float) -> bool:
        """Whether it moves as a drift of this mean rate may move it."""
        expected = rate_um_per_s * self.seconds
        along = self.moved_um if expected >= 0 else -self.moved_um
        return along + 3 * self.moved_std_um >= SLOWEST * abs(expected)


Course = Callable[[RecordOffset], float]
"""What multiplies an amount at a later record."""


@dataclass(frozen=True)
class Shift:
    """A step of the zero (um) or a drift of it (um/s), with the half-width of its 95 % interval."""

    amount: float
    half: float
    sure: bool
    """Whether it is beyond chance, found again in held-out records and shown by records at rest as well."""
    left_um2: float
    """Sum of squares that remains of the offsets."""
    chance: float
    """Probability of as much by chance."""


def session_shifts(
    reference: Sequence[RecordOffset],
    train: Sequence[RecordOffset],
    holdout: Sequence[RecordOffset],
    unexplained_um: float = 0.0,
) -> Mapping[str, Shift]:
    """A step and a drift, each by the name of the effect it would be. A drift that goes on beyond any step refutes the
    step by itself. What is unexplained of the records about their means, rms, may shift these too.

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
    found = {step: _shift(before, later, held, at_rest, None, unexplained_um)}
    if min(r.t_s for r in later) <= began_s:
        return found
    alone, beyond = (
        _shift(before, later, held, at_rest, began_s, unexplained_um, beyond_step=b) for b in (False, True)
    )
    found[drift] = alone
    if beyond.chance < ERROR_RATE and not (alone.sure and alone.left_um2 <= DISTINCT * beyond.left_um2):
        # Not a step alone; which of the two there is, or both, only a sure drift tells.
        goes_on = all(r.may_drift_at(beyond.amount) for r in at_rest[1])
        stepped = found[step].sure and goes_on
        found[step] = replace(found[step], sure=stepped and not beyond.sure)
        sure = goes_on and (alone.sure or stepped or beyond.sure)
        found[drift] = replace(beyond, sure=sure, left_um2=found[step].left_um2)
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
    *,
    beyond_step: bool = False,
) -> Shift:
    """The shift of ``later`` records against those ``before``: a drift from ``began_s`` on, or a step where None.

    ``at_rest`` are the records at rest before and later: they stand off as far, and a drift goes on in them.
    ``beyond_step``: the drift beside a step of any size.
    """
    columns: list[Course] = [_stepped if began_s is None else _drifted(began_s), *([_stepped] if beyond_step else [])]
    amounts, error, scatter, p = _fitted(before, later, columns)
    again, _, _, p_again = _fitted(before, held, columns)
    moved = [abs(amounts[0] * columns[0](r)) for r in later]
    reach = max(moved) - (min(moved) if beyond_step else 0.0)
    was = float(np.mean([r.mean_um for r in at_rest[0]]))
    seen_at_rest = all(
        abs(r.mean_um - was - (e := sum(a * of(r) for a, of in zip(amounts, columns, strict=True))))
        < np.hypot(AT_REST * e, 3 * scatter)
        for r in at_rest[1]
    )
    if began_s is not None:
        seen_at_rest = seen_at_rest and all(r.may_drift_at(amounts[0]) for r in at_rest[1])
    found_again = p_again < ERROR_RATE and amounts[0] * again[0] > 0
    sure = seen_at_rest and p < FOUND and found_again and reach > LEAST_SHIFT * max(scatter, unexplained_um)
    freedom = max(len(before) + len(later) - 1 - len(columns), 1)
    half = float(t_distribution.isf(0.025, freedom)) * error
    return Shift(amounts[0], half, bool(sure), scatter**2 * freedom, p)


def _stepped(record: RecordOffset) -> float:
    """What multiplies a step at a later record."""
    return 1.0


def _drifted(began_s: float) -> Course:
    """What multiplies a drift from ``began_s`` on at a later record: the seconds since."""
    return lambda record: record.t_s - began_s


def _fitted(
    before: Sequence[RecordOffset], after: Sequence[RecordOffset], columns: Sequence[Course]
) -> tuple[list[float], float, float, float]:
    """Amount of each course, and of the first its standard error, the scatter of the records about the fit, and the
    probability of as much by chance."""
    shapes = [[0.0] * len(before) + [course(r) for r in after] for course in columns]
    design: Samples = np.stack([np.ones(len(before) + len(after)), *map(np.array, shapes)], axis=1)
    y = np.array([r.mean_um for r in (*before, *after)])
    amounts, *_ = np.linalg.lstsq(design, y, rcond=None)
    freedom = max(len(y) - design.shape[1], 1)
    scatter = float(np.sqrt(np.sum((y - design @ amounts) ** 2) / freedom))
    error = scatter * float(np.sqrt(np.linalg.pinv(design.T @ design)[1, 1]))
    p = 2 * float(t_distribution.sf(abs(amounts[1]) / max(error, 1e-15), freedom))
    return amounts[1:].tolist(), error, scatter, p
