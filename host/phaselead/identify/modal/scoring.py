"""Score test of what else may shape the pushes, beside fitted common modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.identify.modal.model import Drive, ModalModel
from phaselead.identify.modal.time_domain import (
    Changes,
    ModalFit,
    Point,
    centred,
    inverse_of,
    normal_equations,
    poles_size,
)
from phaselead.record import Samples

POWERLESS = 1e-4
"""A change of the pushes whose squares poles and shares take up but for this share cannot be told from them."""


@dataclass(frozen=True)
class ScoreTest:
    """Per change of the pushes (changes,): its best amount, the standard deviation of that, and the share of the
    squares that it would explain."""

    amounts: Samples
    std: Samples
    share: Samples


def score_test(
    fit: ModalFit,
    split: Samples,
    drives: Sequence[Drive],
    weights: Samples,
    changes: Changes,
    count: int,
    *,
    held: bool = False,
) -> ScoreTest:
    """Score test of changes of the pushes, each by itself, poles and shares being free to follow.

    ``held``: these stay, and only shifts that were fitted follow.
    """
    point = Point(fit.model.poles, fit.shift, np.zeros(0), split, fit.model if held else None)
    normal = normal_equations(point, fit.model, drives, weights, changes, count)
    at = poles_size(point)
    free = slice(point.fixed, at)
    cross = normal.matrix[free, at:]
    taken = inverse_of(normal.matrix[free, free]) @ cross
    power = np.diag(normal.matrix[at:, at:]) - np.sum(cross * taken, axis=0)
    scores = normal.scores[:, at:] - normal.scores[:, free] @ taken
    slope = normal.slope[at:] - taken.T @ normal.slope[free]
    seen = power > POWERLESS * np.maximum(np.diag(normal.matrix[at:, at:]), 1e-300)
    power = np.where(seen, power, np.inf)
    amounts = slope / power
    variance = np.maximum(1.0, (scores**2).sum(axis=0) / power) / power
    squares = _squares(fit.model, drives, weights)
    return ScoreTest(amounts, np.where(seen, np.sqrt(variance), np.inf), slope * amounts / squares)


def _squares(model: ModalModel, drives: Sequence[Drive], weights: Samples) -> float:
    total = 0.0
    for drive, weight in zip(drives, weights, strict=True):
        total += float(np.sum(centred(drive.x_um - model.answer(drive), drive.rows, weight) ** 2))
    return total
