"""A zero that moved between the reference session and the later ones, at once or steadily.

The search compares every record about its own offset and so cannot see this. Here the offsets themselves are the data,
one number per record: a step after the reference session, or a drift that begins with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as t_distribution

from phaselead.model import catalogue
from phaselead.record import Samples

ALL_P, HELD_OUT_P = 1e-6, 1e-2
"""Largest probability of a shift by chance, over all records and over the held-out ones against the reference."""
LEAST_SHIFT = 5.0
"""Smallest shift that counts, in units of the scatter of single records."""
DISTINCT = 2.0
"""Ratio of squared residuals from which a step and a drift can be told apart."""
AT_REST = 0.2
"""Share of the shift by which records at rest may differ from it."""
FEWEST = 3
"""Driven records of a session from which its scatter can be told."""


@dataclass(frozen=True)
class RecordOffset:
    """Mean residual (um) of one record, at the middle of its time; ``idle`` where nothing was driven."""

    t_s: float
    mean_um: float
    idle: bool = False


@dataclass(frozen=True)
class Shift:
    """A step of the zero (um) or a drift of it (um/s), with the half-width of its 95 % interval."""

    amount: float
    half: float
    sure: bool
    """Whether it is beyond chance, found again in held-out records and shown by records at rest as well."""
    left_um2: float
    """Sum of squares that remains of the offsets."""


def session_shifts(
    reference: Sequence[RecordOffset], train: Sequence[RecordOffset], holdout: Sequence[RecordOffset]
) -> Mapping[str, Shift]:
    """A step and a drift, each by the name of the effect it would be.

    Empty where the records do not suffice: driven ones of both sessions, and ones at rest of both, since anything that
    changes how the stage answers shifts the driven ones alone.
    """
    every = [list(reference), list(train), list(holdout)]
    before, learned, held = ([r for r in part if not r.idle] for part in every)
    at_rest = [r for r in every[0] if r.idle], [r for part in every[1:] for r in part if r.idle]
    if min(len(before), len(learned)) < FEWEST or not (held and at_rest[0] and at_rest[1]):
        return {}
    later, began_s = [*learned, *held], max(r.t_s for r in before)
    starts = {"at once": None, "steadily": began_s}
    return {
        e.name: _shift(before, later, held, at_rest, starts[e.moves_zero])
        for e in catalogue().values()
        if e.moves_zero == "at once" or (e.moves_zero == "steadily" and min(r.t_s for r in later) > began_s)
    }


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
) -> Shift:
    """The shift of ``later`` records against those ``before``: a drift from ``began_s`` on, or a step where None.

    ``at_rest`` are the records at rest before and later.
    """
    amount, error, scatter, p = _fitted(before, later, began_s)
    again, _, _, p_again = _fitted(before, held, began_s)
    reach = max(abs(amount) * _shape(r, began_s) for r in later)
    was = float(np.mean([r.mean_um for r in at_rest[0]]))
    seen_at_rest = all(
        abs(r.mean_um - was - (e := amount * _shape(r, began_s))) < np.hypot(AT_REST * e, 3 * scatter)
        for r in at_rest[1]
    )
    sure = seen_at_rest and p < ALL_P and p_again < HELD_OUT_P and amount * again > 0 and reach > LEAST_SHIFT * scatter
    freedom = len(before) + len(later) - 2
    return Shift(amount, float(t_distribution.isf(0.025, freedom)) * error, bool(sure), scatter**2 * freedom)


def _shape(record: RecordOffset, began_s: float | None) -> float:
    """What multiplies the amount at a later record: 1 for a step, the seconds of drift otherwise."""
    return 1.0 if began_s is None else record.t_s - began_s


def _fitted(
    before: Sequence[RecordOffset], after: Sequence[RecordOffset], began_s: float | None
) -> tuple[float, float, float, float]:
    """Amount, standard error, scatter of the records about the fit, and probability of as much by chance."""
    shape = [0.0] * len(before) + [_shape(r, began_s) for r in after]
    design: Samples = np.stack([np.ones(len(shape)), np.array(shape)], axis=1)
    y = np.array([r.mean_um for r in (*before, *after)])
    amounts, *_ = np.linalg.lstsq(design, y, rcond=None)
    freedom = max(len(y) - 2, 1)
    scatter = float(np.sqrt(np.sum((y - design @ amounts) ** 2) / freedom))
    error = scatter * float(np.sqrt(np.linalg.pinv(design.T @ design)[1, 1]))
    p = 2 * float(t_distribution.sf(abs(amounts[1]) / max(error, 1e-15), freedom))
    return float(amounts[1]), error, scatter, p
