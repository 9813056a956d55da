"""Model discrepancy: what the base misses on the reference records, in terms of the catalogue, and how surely.

A reference record is known to be without the missing effect. Whatever part of its residual an effect of the
catalogue seems to explain there is a fault of the base, present in the other records too, and must not be named: it
is subtracted, and its uncertainty kept as a shrunk nuisance (Kennedy and O'Hagan 2001, Bayesian calibration). So an
effect is credited only with the difference between the sessions, as in a two-sample test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from phaselead.gap.metric import LEAST_POWER, Metric, Regressors, conditional_on, fair_weights, nuisance_factor
from phaselead.gap.regressors import Index, Layout
from phaselead.record import Samples

FOLDS = 4
"""Parts of the reference records, each explained by the others."""
MISSED_STD = 1.0
"""Prior deviation of a fault of the base, in typical sizes of the effect it looks like."""
FLEXIBLE_STD = 3.0
"""The same where every column may explain the residual, to learn what noise remains."""
HELD_PRECISION = 1e12
"""Prior precision of a column that may take nothing."""
REFERENCE_WEIGHT_ROUNDS = 3
"""In which weights and discrepancy are found in turn."""


@dataclass(frozen=True)
class Discrepancy:
    """Amounts of some columns that every record carries, as a normal distribution."""

    index: Index
    """(m,) the columns."""
    mean: Samples
    """(m,)"""
    precision: Samples
    """(m, m), the inverse of their covariance."""

    def at(self, index: Index) -> Discrepancy:
        """The same for a layout in which its columns stand at ``index`` (m,)."""
        return Discrepancy(index, self.mean, self.precision)

    def mean_removed(self, moment: Samples, target: int) -> Samples:
        """Moments (..., k, k) with the mean amounts taken out of column ``target``."""
        shifted = np.array(moment)
        shifted[..., target] -= moment[..., self.index] @ self.mean
        shifted[..., target, :] -= self.mean @ shifted[..., self.index, :]
        return shifted

    def conditional(self, moment: Samples, target: int) -> Samples:
        """A moment (k, k) with the mean taken out of column ``target``, conditional on what is uncertain about it."""
        return conditional_on(self.mean_removed(moment, target), self.index, self.precision)

    def factor(self, moment: Samples) -> tuple[Samples, bool]:
        """Cholesky factor of its columns' part of a moment (k, k) and its precision, for ``cho_solve``."""
        return nuisance_factor(moment, self.index, self.precision)


def discrepancy_prior(layout: Layout, frozen: bool) -> Discrepancy:
    """The discrepancy where no reference record tells of it: what a refit of the base could change, by one prior
    deviation, or nothing when the base is frozen."""
    precision = np.full(layout.size, HELD_PRECISION)
    if not frozen:
        precision[layout.base] = 1.0
    return Discrepancy(np.arange(layout.size), np.zeros(layout.size), np.diag(precision))


def reference_discrepancy(regressors: Regressors, errors: Sequence[Samples]) -> tuple[Discrepancy, list[Samples]]:
    """The discrepancy that explains the residuals (n,) of the reference runs, and weights (blocks,) per run by what it
    leaves of the blocks of each fold when it is fitted to the other folds."""
    target = regressors.size
    moments = regressors.with_columns([e[:, None] for e in errors])
    index = np.arange(regressors.size)
    precision = np.eye(len(index)) / MISSED_STD**2
    rows = [np.diff(e) for e in regressors.metric.edges]
    weights, folds = list(regressors.metric.weights), folds_of(regressors.metric)
    for _ in range(REFERENCE_WEIGHT_ROUNDS):
        scaled = moments * np.concatenate(weights)[:, None, None]
        left = _left_out(moments, scaled, index, target, precision, folds)
        parts = np.split(left, np.cumsum([len(r) for r in rows])[:-1])
        weights = [fair_weights(part, r.astype(np.float64)) for part, r in zip(parts, rows, strict=True)]
    total = (moments * np.concatenate(weights)[:, None, None]).sum(axis=0)
    return _fitted(total, index, target, precision), weights


def _fitted(moment: Samples, index: Index, target: int, precision: Samples) -> Discrepancy:
    """The columns ``index`` fitted to column ``target`` of a moment (k, k) under a prior of mean 0."""
    inner = moment[np.ix_(index, index)] + precision
    return Discrepancy(index, cho_solve(cho_factor(inner), moment[index, target]), inner)


def folds_of(metric: Metric) -> Index:
    """A fold for each block, (blocks,): quarters of every record, so that few blocks have a neighbour in another
    fold."""
    parts = [np.arange(len(e) - 1) * FOLDS // (len(e) - 1) for e in metric.edges]
    return np.concatenate([(part + i) % FOLDS for i, part in enumerate(parts)]).astype(np.intp)


def _left_out(
    moments: Samples, scaled: Samples, index: Index, target: int, precision: Samples, folds: Index
) -> Samples:
    """Squares (blocks,) left of column ``target`` when each fold of blocks is explained by what the others say.

    ``moments`` (blocks, k, k) are unweighted, ``scaled`` are weighted.
    """
    total, left = scaled.sum(axis=0), np.zeros(len(moments))
    for fold in range(FOLDS):
        kept = total - scaled[folds == fold].sum(axis=0)
        amounts = np.zeros(len(total))
        amounts[index] = -_fitted(kept, index, target, precision).mean
        amounts[target] = 1.0
        for block in np.flatnonzero(folds == fold):
            left[block] = float(amounts @ moments[block] @ amounts)
    return left


def flexible_residual(moments: Samples, discrepancy: Discrepancy, fitted: Index, target: int) -> Samples:
    """Amounts (k,) of all columns, 1 of ``target``, whose sum is the residual that remains when the columns ``fitted``
    may explain it beside the discrepancy, each within a weak prior. ``moments`` are (blocks, k, k)."""
    total = discrepancy.mean_removed(moments, target).sum(axis=0)
    every = np.concatenate([np.setdiff1d(fitted, discrepancy.index), discrepancy.index]).astype(np.intp)
    precision = np.eye(len(every)) / FLEXIBLE_STD**2
    n = len(discrepancy.index)
    precision[-n:, -n:] = discrepancy.precision if n else 0
    inner = total[np.ix_(every, every)] + precision
    amounts = np.zeros(len(total))
    amounts[every] = -cho_solve(cho_factor(inner), total[every, target])
    amounts[target] = 1.0
    if n:
        amounts[discrepancy.index] -= discrepancy.mean
    return amounts


def inflation_by_reference(regressors: Regressors, layout: Layout, errors: Sequence[Samples]) -> dict[str, float]:
    """By how much gains of each effect are overstated, at least 1, by its name.

    A fold of the reference residual is explained by what the other folds say the base misses. The references are
    without the effects, so that what an effect still gains there is a mistake. The inflation is the mean square of its
    score over the folds against what white noise gives, or its gain over all of them against the price of a parameter,
    whichever is more. ``regressors`` are those of the whole ``layout`` on the reference runs, ``errors`` their
    residuals (n,).
    """
    score, power = _scores_by_fold(regressors, layout, errors)
    price = float(np.log(max(regressors.metric.rows, 3)))
    found: dict[str, float] = {}
    for i, group in enumerate(layout.groups):
        for column in layout.columns_of(i):
            whole = float(power[:, column].sum())
            if whole > LEAST_POWER:
                scatter = float((score[:, column] ** 2).sum()) / whole
                coherent = float(score[:, column].sum()) ** 2 / whole / price
                found[group.effect.name] = max(found.get(group.effect.name, 1.0), scatter, coherent)
    return found


def _scores_by_fold(regressors: Regressors, layout: Layout, errors: Sequence[Samples]) -> tuple[Samples, Samples]:
    """Products (folds, k) of each column with what the other folds leave of the residual, and squares (folds, k) of the
    columns themselves, conditional on the discrepancy."""
    target = regressors.size
    moments = regressors.with_columns([e[:, None] for e in errors])
    index, folds = layout.common(), folds_of(regressors.metric)
    precision = np.eye(len(index)) / MISSED_STD**2
    total = moments.sum(axis=0)
    scores, powers = [], []
    for fold in range(int(folds.max()) + 1):
        inside = moments[folds == fold].sum(axis=0)
        left = _fitted(total - inside, index, target, precision).conditional(inside, target)
        scores.append(left[:target, target])
        powers.append(np.diag(left)[:target])
    return np.array(scores), np.maximum(np.array(powers), 0.0)
