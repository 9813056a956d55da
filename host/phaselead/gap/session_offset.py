"""A zero that moved between the reference session and the others, at once or little by little.

Every record is compared about its own offset, so the search sees nothing of it. Here the offsets themselves are the
data, one number a record: a step at the end of the reference session, or a drift that began there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as t_distribution

from phaselead.record import Samples

SURE, AGAIN = 1e-6, 1e-2
"""Of all records together, and of held-out ones against the reference."""
BEYOND = 5.0
"""Times the scatter of single records: less is no other zero."""
APART = 2.0
"""Ratio of squared residuals from which a step and a drift are told apart."""
AT_REST = 0.2
"""Of the shift: how far idle records may be from showing it too."""
FEWEST = 3
"""Records of a session that tell its scatter."""


@dataclass(frozen=True)
class RecordOffset:
    """What a model leaves of a record on average, at the middle of its time."""

    t_s: float
    mean_um: float
    idle: bool = False


@dataclass(frozen=True)
class Shift:
    """How much later sessions stand off the reference's (um), or drift away from it (um/s); 95 % half-width."""

    amount: float
    half: float
    sure: bool
    left_um2: float
    """Sum of squares that it leaves."""


def session_shifts(
    reference: Sequence[RecordOffset], train: Sequence[RecordOffset], holdout: Sequence[RecordOffset]
) -> Mapping[str, Shift]:
    """By name of the effect; empty where too few records tell: driven ones, and idle ones of both times, since anything
    that changes how the stage answers shifts the driven ones alone."""
    every = [list(reference), list(train), list(holdout)]
    before, learned, held = ([r for r in part if not r.idle] for part in every)
    still = [r for r in every[0] if r.idle], [r for part in every[1:] for r in part if r.idle]
    if min(len(before), len(learned)) < FEWEST or not (held and still[0] and still[1]):
        return {}
    later, began_s = [*learned, *held], max(r.t_s for r in before)
    found = {"offset": _shift(before, later, held, still, None)}
    if min(r.t_s for r in later) > began_s:
        found["thermal_drift"] = _shift(before, later, held, still, began_s)
    return found


def best_explained(shifts: Mapping[str, Shift]) -> tuple[str, ...]:
    """The sure one, or both where the records do not tell which."""
    sure = sorted((name for name, shift in shifts.items() if shift.sure), key=lambda name: shifts[name].left_um2)
    if not sure:
        return ()
    best = shifts[sure[0]].left_um2
    return tuple(name for name in sure if shifts[name].left_um2 <= APART * best)


def _shift(
    before: Sequence[RecordOffset],
    later: Sequence[RecordOffset],
    held: Sequence[RecordOffset],
    still: tuple[Sequence[RecordOffset], Sequence[RecordOffset]],
    began_s: float | None,
) -> Shift:
    amount, error, scatter, p = _fitted(before, later, began_s)
    again, _, _, p_again = _fitted(before, held, began_s)
    reach = max(abs(amount) * _shape(r, began_s) for r in later)
    was = float(np.mean([r.mean_um for r in still[0]]))
    at_rest = all(
        abs(r.mean_um - was - (e := amount * _shape(r, began_s))) < np.hypot(AT_REST * e, 3 * scatter) for r in still[1]
    )
    sure = at_rest and p < SURE and p_again < AGAIN and amount * again > 0 and reach > BEYOND * scatter
    freedom = len(before) + len(later) - 2
    return Shift(amount, float(t_distribution.isf(0.025, freedom)) * error, bool(sure), scatter**2 * freedom)


def _shape(record: RecordOffset, began_s: float | None) -> float:
    """Of the shift at a later record: 1, or the seconds of drift."""
    return 1.0 if began_s is None else record.t_s - began_s


def _fitted(
    before: Sequence[RecordOffset], after: Sequence[RecordOffset], began_s: float | None
) -> tuple[float, float, float, float]:
    """Its amount, standard error, the scatter of records about it and the probability of as much by chance."""
    shape = [0.0] * len(before) + [_shape(r, began_s) for r in after]
    design: Samples = np.stack([np.ones(len(shape)), np.array(shape)], axis=1)
    y = np.array([r.mean_um for r in (*before, *after)])
    amounts, *_ = np.linalg.lstsq(design, y, rcond=None)
    freedom = max(len(y) - 2, 1)
    scatter = float(np.sqrt(np.sum((y - design @ amounts) ** 2) / freedom))
    error = scatter * float(np.sqrt(np.linalg.pinv(design.T @ design)[1, 1]))
    p = 2 * float(t_distribution.sf(abs(amounts[1]) / max(error, 1e-15), freedom))
    return float(amounts[1]), error, scatter, p
