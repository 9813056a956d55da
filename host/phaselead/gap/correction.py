"""What the base misses on the reference records, described by the catalogue itself, and how surely.

A reference record is known to be without the missing effect. Whatever part of its residual an effect of the
catalogue seems to explain there is a fault of the base, present in the other records too, and must not be named: it
is subtracted, and its uncertainty kept as a shrunk nuisance. So an effect is credited only with the difference
between the sessions, as in a two-sample test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from phaselead.gap.evidence import Evidence, fair_weights
from phaselead.gap.panel import Index, Layout, Panel, condition, nuisance_factor
from phaselead.record import Samples

FOLDS = 4
MISSED_STD = 1.0
"""Typical sizes: how large a fault of the base may look before any data are seen."""
FLEXIBLE_STD = 3.0
HELD = 1e12


@dataclass(frozen=True)
class Correction:
    """Columns ``index`` of a layout carry amounts of this mean and precision in every record."""

    index: Index
    mean: Samples
    precision: Samples

    def at(self, index: Index) -> Correction:
        """The same for a layout in which its columns stand at ``index``."""
        return Correction(index, self.mean, self.precision)

    def applied(self, moment: Samples, target: int) -> Samples:
        """Moments (..., k, k) with the mean amounts taken out of column ``target``, before conditioning."""
        shifted = np.array(moment)
        shifted[..., target] -= moment[..., self.index] @ self.mean
        shifted[..., target, :] -= self.mean @ shifted[..., self.index, :]
        return shifted

    def conditioned(self, moment: Samples, target: int) -> Samples:
        """Moment (k, k) with the correction taken out and its uncertainty as a nuisance."""
        return condition(self.applied(moment, target), self.index, self.precision)

    def factor(self, moment: Samples) -> tuple[Samples, bool]:
        """Of its columns in a moment (k, k), as ``scipy.linalg.cho_solve`` takes it."""
        return nuisance_factor(moment, self.index, self.precision)


def prior(layout: Layout, frozen: bool) -> Correction:
    """Without reference records: only what a refit of the base could change, or nothing when it is frozen."""
    precision = np.full(layout.size, HELD)
    if not frozen:
        precision[layout.base] = 1.0
    return Correction(np.arange(layout.size), np.zeros(layout.size), np.diag(precision))


def from_reference(panel: Panel, errors: Sequence[Samples]) -> tuple[Correction, list[Samples]]:
    """The correction, and weights (blocks,) per track by what it leaves of blocks left out."""
    target = panel.size
    moments = panel.with_columns([e[:, None] for e in errors])
    index = np.arange(panel.size)
    precision = np.eye(len(index)) / MISSED_STD**2
    rows = [np.diff(e) for e in panel.evidence.edges]
    weights, folds = list(panel.evidence.weights), folds_of(panel.evidence)
    for _ in range(3):
        scaled = moments * np.concatenate(weights)[:, None, None]
        left = _left_out(moments, scaled, index, target, precision, folds)
        parts = np.split(left, np.cumsum([len(r) for r in rows])[:-1])
        weights = [fair_weights(part, r.astype(np.float64)) for part, r in zip(parts, rows, strict=True)]
    total = (moments * np.concatenate(weights)[:, None, None]).sum(axis=0)
    inner = total[np.ix_(index, index)] + precision
    mean = cho_solve(cho_factor(inner), total[index, target])
    return Correction(index, mean, inner), weights


def folds_of(evidence: Evidence) -> Index:
    """(blocks,) a fold for each block: quarters of every record, so that what is left out is not next to what is in."""
    parts = [np.arange(len(e) - 1) * FOLDS // (len(e) - 1) for e in evidence.edges]
    return np.concatenate([(part + i) % FOLDS for i, part in enumerate(parts)]).astype(np.intp)


def _left_out(
    moments: Samples, scaled: Samples, index: Index, target: int, precision: Samples, folds: Index
) -> Samples:
    """Squares (blocks,) left when each fold of blocks is explained by the others."""
    total, left = scaled.sum(axis=0), np.zeros(len(moments))
    for fold in range(FOLDS):
        kept = total - scaled[folds == fold].sum(axis=0)
        amounts = np.zeros(len(total))
        inner = kept[np.ix_(index, index)] + precision
        amounts[index] = -cho_solve(cho_factor(inner), kept[index, target])
        amounts[target] = 1.0
        for block in np.flatnonzero(folds == fold):
            left[block] = float(amounts @ moments[block] @ amounts)
    return left


def flexible_left(moments: Samples, correction: Correction, fitted: Index, target: int) -> Samples:
    """Amounts (k,) (target 1) of the residual that remains when every column may explain it, weakly bounded."""
    total = correction.applied(moments, target).sum(axis=0)
    every = np.concatenate([np.setdiff1d(fitted, correction.index), correction.index]).astype(np.intp)
    precision = np.eye(len(every)) / FLEXIBLE_STD**2
    n = len(correction.index)
    precision[-n:, -n:] = correction.precision if n else 0
    inner = total[np.ix_(every, every)] + precision
    amounts = np.zeros(len(total))
    amounts[every] = -cho_solve(cho_factor(inner), total[every, target])
    amounts[target] = 1.0
    if n:
        amounts[correction.index] -= correction.mean
    return amounts
