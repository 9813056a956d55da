"""Mean products of columns in each block, kept apart by whose the columns are.

A set of effects has its tangents and its residual. What the base may miss has columns that all sets share: their
products with each other are found once. What went on before a record began has columns of that record alone: their
products with those of other records are 0, and they are eliminated record by record.

Blocks are weighed in s ways at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from phaselead.record import Samples

Integers = NDArray[np.intp]
"""Places, counts or octaves, (k,)."""


@dataclass(frozen=True)
class Amounts:
    """m numbers for each column, s times."""

    common: Samples
    """(s, c, m) of the columns that all records share."""
    before: Samples
    """(s, runs, b, m) of those that a record has for itself."""

    def __sub__(self, other: Amounts) -> Amounts:
        return Amounts(self.common - other.common, self.before - other.before)

    def __getitem__(self, which: int | Integers) -> Amounts:
        """Some of the s."""
        rows = np.atleast_1d(which)
        return Amounts(self.common[rows], self.before[rows])

    def put(self, which: Integers, amounts: Amounts) -> None:
        """Set some of the s."""
        self.common[which], self.before[which] = amounts.common, amounts.before

    def behind(self, zeros: int) -> Amounts:
        """The same behind so many more common columns, of which there is nothing."""
        s, _, m = self.common.shape
        return Amounts(np.concatenate([np.zeros((s, zeros, m)), self.common], axis=1), self.before)

    def largest(self) -> Samples:
        """(s,) of the magnitudes."""
        largest = np.abs(self.common).max(axis=(1, 2), initial=0.0)
        return np.asarray(np.maximum(largest, np.abs(self.before).max(axis=(1, 2, 3), initial=0.0)))

    def along(self, others: Amounts) -> Samples:
        """(s, m, m) products with others, added up over the columns."""
        return np.asarray(_crossed(self.common, others.common) + _crossed(_flat(self.before), _flat(others.before)))


def together(several: Sequence[Amounts]) -> Amounts:
    """All of several as one."""
    return Amounts(np.concatenate([one.common for one in several]), np.concatenate([one.before for one in several]))


class SharedProducts:
    """Mean products (blocks, k, k) of the shared columns, one triangle of each."""

    def __init__(self, products: Samples) -> None:
        self.size = int(products.shape[1])
        self._at = np.triu_indices(self.size)
        self._triangles = products[:, self._at[0], self._at[1]]
        self._twice = np.where(self._at[0] == self._at[1], 1.0, 2.0)

    @cached_property
    def whole(self) -> Samples:
        """(blocks, k, k), both triangles."""
        return self._filled(self._triangles)

    def power(self, amounts: Samples) -> Samples:
        """Mean power (s, blocks) of so many (s, k) of the columns together."""
        rows, columns = self._at
        return np.asarray((self._twice * amounts[:, rows] * amounts[:, columns]) @ self._triangles.T)

    def total(self, weights: Samples) -> Samples:
        """Sum (s, k, k) over the blocks, each by its weight (s, blocks)."""
        return self._filled(weights @ self._triangles)

    def _filled(self, triangles: Samples) -> Samples:
        rows, columns = self._at
        found: Samples = np.empty((len(triangles), self.size, self.size))
        found[:, rows, columns] = found[:, columns, rows] = triangles
        return found


@dataclass(frozen=True)
class Moments:
    """Mean products of tangents, of columns that are integrated out with a deviation of 1, and of the residual."""

    own: Samples
    """(blocks, p + b + 1, p + b + 1) of the tangents of p parameters, b columns of the record alone, and the
    residual."""
    across: Samples
    """(blocks, p + b + 1, k) of these with the shared columns."""
    shared: SharedProducts
    runs: Sequence[int]
    """Blocks at which the records begin, and their number."""
    tangents: int
    """p"""
    moving: Samples
    """(runs, b) 1 where a column of a record counts, 0 where what it is for is over."""
    all_moving: Moments | None = None
    """The same where every column counts; None where that is so here."""

    def where_moving(self, moving: Samples) -> Moments:
        """The same where only these (runs, b) columns of the records count."""
        every = self.all_moving or self
        always = np.ones((len(moving), self.tangents + 1))
        of_records = np.concatenate([always[:, :-1], moving, always[:, -1:]], axis=1)
        kept = np.repeat(of_records, np.diff(self.runs), axis=0)[:, :, None]
        own, across = every.own * kept * kept.transpose(0, 2, 1), every.across * kept
        return replace(every, own=own, across=across, moving=moving, all_moving=every)

    @property
    def _before(self) -> int:
        """b"""
        return int(self.own.shape[1]) - 1 - self.tangents

    @property
    def columns(self) -> int:
        """How many are integrated out of a record."""
        return self.shared.size + self._before

    def none(self, s: int) -> Amounts:
        """Nothing of what is integrated out, s times."""
        return Amounts(np.zeros((s, self.shared.size, 1)), np.zeros((s, len(self.runs) - 1, self._before, 1)))

    @cached_property
    def integrated(self) -> Moments:
        """The same without the tangents."""
        p = self.tangents
        own, across = self.own[:, p:, p:].copy(), self.across[:, p:].copy()
        return replace(self, own=own, across=across, tangents=0, all_moving=None)

    def with_residual(self, own: Samples, across: Samples) -> Moments:
        """The same without the tangents, of another residual: its products (blocks, b + 1) with the columns of the
        record and itself, and those (blocks, k) with the shared ones."""
        rest = self.integrated
        all_own, all_across = rest.own.copy(), rest.across.copy()
        all_own[:, -1], all_own[:, :, -1], all_across[:, -1] = own, own, across
        return replace(rest, own=all_own, across=all_across)

    def power(self, amounts: Amounts) -> Samples:
        """Mean power (s, blocks) of the residual less amounts of the k and b columns."""
        moments, common = self.integrated, amounts.common[..., 0]
        of_residual = np.ones((*amounts.before.shape[:2], 1))
        with_residual = np.concatenate([-amounts.before[..., 0], of_residual], axis=2)
        taken = np.repeat(with_residual, np.diff(self.runs), axis=1).transpose(1, 0, 2)
        left = taken @ moments.own - 2 * (moments.across @ common.T).transpose(0, 2, 1)
        return np.asarray(np.maximum((left * taken).sum(axis=2).T + self.shared.power(common), 0.0))

    def normal(self, weights: Samples, precision: Samples) -> tuple[Normal, Amounts]:
        """Normal equations of the p + k and b columns, each block by its weight (s, blocks): their matrix with the
        priors, ``precision`` (p,) of the parameters, and their right side."""
        p, k, b = self.tangents, self.shared.size, self._before
        own, across = self._of_runs(weights, self.own), self._of_runs(weights, self.across)
        common: Samples = np.empty((len(weights), p + k, p + k))
        common[:, :p, :p], common[:, :p, p:] = own[:, :, :p, :p].sum(axis=1), across[:, :, :p].sum(axis=1)
        common[:, p:, :p], common[:, p:, p:] = common[:, :p, p:].transpose(0, 2, 1), self.shared.total(weights)
        common += np.diag(np.append(precision, np.ones(k)))
        beside = np.concatenate([own[:, :, p:-1, :p], across[:, :, p:-1]], axis=3)
        right = np.concatenate([own[:, :, :p, -1], across[:, :, -1]], axis=2).sum(axis=1)
        normal = Normal(common, beside, own[:, :, p:-1, p:-1] + np.eye(b))
        return normal, Amounts(right[:, :, None], own[:, :, p:-1, -1:])

    def _of_runs(self, weights: Samples, products: Samples) -> Samples:
        """Sums (s, runs, ...) of products (blocks, ...) over the blocks of each record."""
        shape = products.shape[1:]
        flat = products.reshape(len(products), shape[0] * shape[1])
        sums = [weights[:, a:b] @ flat[a:b] for a, b in pairwise(self.runs)]
        return np.stack(sums, axis=1).reshape(len(weights), len(sums), *shape)


@dataclass(frozen=True)
class Normal:
    """s symmetric, positive definite matrices over c columns that all records share and b that each record has for
    itself."""

    common: Samples
    """(s, c, c)"""
    beside: Samples
    """(s, runs, b, c)"""
    before: Samples
    """(s, runs, b, b)"""

    @cached_property
    def reduced(self) -> Samples:
        """(s, c, c) of the common columns, those of the records eliminated: its inverse is their part of the inverse of
        the whole."""
        return np.asarray(self.common - _crossed(_flat(self.beside), _flat(self._eliminated)))

    @cached_property
    def _eliminated(self) -> Samples:
        return _solved(self.before, self.beside)

    @property
    def log_determinant(self) -> Samples:
        """(s,) of the whole."""
        return np.asarray(np.linalg.slogdet(self.reduced)[1] + np.linalg.slogdet(self.before)[1].sum(axis=1))

    def solve(self, right: Amounts) -> Amounts:
        """What multiplied by the matrices gives ``right``."""
        of_records = _crossed(_flat(self._eliminated), _flat(right.before))
        common, own = _solved(self.reduced, right.common - of_records), _solved(self.before, right.before)
        return Amounts(common, own - self._eliminated @ common[:, None])

    def times(self, amounts: Amounts) -> Amounts:
        """The matrices by columns."""
        common = self.common @ amounts.common + _crossed(_flat(self.beside), _flat(amounts.before))
        return Amounts(common, self.beside @ amounts.common[:, None] + self.before @ amounts.before)

    def damped(self, damping: float) -> Normal:
        """The same with larger diagonals."""
        common, before = (part * (1 + damping * np.eye(part.shape[-1])) for part in (self.common, self.before))
        return replace(self, common=common, before=before)


def _solved(matrices: Samples, right: Samples) -> Samples:
    """(..., c, m) what multiplied by (..., c, c) gives (..., c, m)."""
    return np.asarray(np.linalg.solve(matrices, right), dtype=np.float64)


def _flat(of_records: Samples) -> Samples:
    """(s, runs, b, m) as (s, runs * b, m)."""
    s, runs, b, m = of_records.shape
    return of_records.reshape(s, runs * b, m)


def _crossed(left: Samples, right: Samples) -> Samples:
    """(s, m, q) products of (s, c, m) and (s, c, q), added up over c."""
    return np.asarray(left.transpose(0, 2, 1) @ right)
