"""The space in which sets of effects are compared: every record whitened, all that the base may miss integrated out.

A record r of one axis is modelled as

    y_r = f_base(u_r) + effects + N_r b_r + B_r (w + e_r) + n_r

with n the noise, N b its own offset and starting memory, B w what the base misses in every record, w ~ N(0, T^2), and
B e_r by how much it misses another amount in this one, e_r ~ N(0, c^2 T^2). T and c are what the reference records
make most likely; a reference record is a row like any other in which the effects are 0. All of it is normal, so that
the product of two columns under the covariance of everything that is not an effect (``Space.inner``) is algebra.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from phaselead.gap.metric import Metric
from phaselead.gap.residual import ModelledRun
from phaselead.record import Samples

Mask = NDArray[np.bool_]
"""Which of the records, (records,)."""


@dataclass(frozen=True)
class SpaceRecord:
    """One record of a space."""

    modelled: ModelledRun
    metric: Metric
    index: int
    """Of the record in its metric."""
    base: Samples
    """Columns (n, k) of what the base may miss, whitened."""

    @property
    def changed(self) -> bool:
        """Whether effects may act in it: it is no reference."""
        return self.modelled.run.role != "reference"


@dataclass(frozen=True)
class Columns:
    """Some columns of every record, whitened: per record (n, q); None where they are 0."""

    white: tuple[Samples | None, ...]
    taken: tuple[Samples | None, ...]
    """(k, q) what the record's own misfit takes of them."""
    shared: tuple[Samples | None, ...]
    """(k, q) products with the base's columns, the own misfit taken out."""

    @property
    def count(self) -> int:
        """How many there are, q."""
        return next((w.shape[1] for w in self.white if w is not None), 0)

    def scaled(self, factor: float) -> Columns:
        """Each of them ``factor`` times."""
        return Columns(*(tuple(None if a is None else factor * a for a in part) for part in self._parts))

    def minus(self, other: Columns, amounts: Samples) -> Columns:
        """Each of them less a combination (p, q) of other columns."""
        found = []
        for mine, theirs in zip(self._parts, other._parts, strict=True):
            pairs = zip(mine, theirs, strict=True)
            found.append(tuple(a if b is None or a is None else a - b @ amounts for a, b in pairs))
        return Columns(*found)

    @property
    def _parts(self) -> tuple[tuple[Samples | None, ...], ...]:
        return self.white, self.taken, self.shared


def joined(*parts: Columns) -> Columns:
    """The columns of all parts side by side."""
    filled = [part for part in parts if part.count]
    if len(filled) == 1:
        return filled[0]

    def side_by_side(arrays: Sequence[Samples | None]) -> Samples | None:
        rows = next((a.shape[0] for a in arrays if a is not None), None)
        if rows is None:
            return None
        wide = [np.zeros((rows, p.count)) if a is None else a for a, p in zip(arrays, filled, strict=True)]
        return np.concatenate(wide, axis=1)

    return Columns(
        *(
            tuple(side_by_side(one) for one in zip(*of_parts, strict=True))
            for of_parts in zip(*(p._parts for p in filled), strict=True)
        )
    )


@dataclass
class Space:
    """Records and the spread of what the base misses in them."""

    records: tuple[SpaceRecord, ...]
    shared: Samples
    """(k, k) root R of the covariance R R' of the amounts of the base's columns that all records have, w."""
    own: Samples
    """(k, k) the same of what each record has of its own beside it, e_r."""
    made_by: Samples
    """(p, k) by which the base's columns are made of the p things that it may miss, whitened."""
    _solved: dict[bytes, tuple[Samples, bool]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._parts = [_own_part(record.base, self.own) for record in self.records]

    @property
    def changed(self) -> Mask:
        """The records in which effects may act."""
        return np.array([record.changed for record in self.records])

    @property
    def all(self) -> Mask:
        """Every record."""
        return np.ones(len(self.records), dtype=bool)

    @property
    def fitted(self) -> Mask:
        """Every record but those held out."""
        return np.array([record.modelled.run.role != "holdout" for record in self.records])

    def usual_weight(self) -> float:
        """What a row of a driven record in which effects act counts in the middle: less than 1 by what no combination
        of effects explains there."""
        driven = [r for r in self.records if r.changed and r.modelled.run.driven]
        return float(np.median(np.concatenate([r.metric.row_weights(r.index) for r in driven or self.records])))

    def whitened(self, index: int, columns: Samples) -> Samples:
        """Columns (n, q) in um of one record: whitened, its own nuisances taken out."""
        record = self.records[index]
        return record.metric.project(record.index, np.asarray(columns, dtype=np.float64))

    def columns(self, per_record: Sequence[Samples | None]) -> Columns:
        """From columns (n, q) in um per record; None is 0."""
        return self.from_white([None if c is None else self.whitened(i, c) for i, c in enumerate(per_record)])

    def from_white(self, white: Sequence[Samples | None]) -> Columns:
        """From whitened columns (n, q) per record; None is 0."""
        pairs = [
            (None, None) if w is None else part.split(record.base.T @ w)
            for w, part, record in zip(white, self._parts, self.records, strict=True)
        ]
        return Columns(tuple(white), *zip(*pairs, strict=True))

    def inner(self, a: Columns, b: Columns, which: Mask) -> Samples:
        """Products (q, p) under the inverse covariance of all that is not an effect, over some records."""
        shared_a = self._shared_part(a, which)
        shared_b = shared_a if b is a else self._shared_part(b, which)
        return np.asarray(self._within(a, b, which) - shared_a.T @ cho_solve(self._factor(which), shared_b))

    def information(self, columns: Columns, which: Mask) -> Samples:
        """Information (k + q, k + q) of some records about what the base misses in all of them, in deviations, prior
        included, and about the amounts of columns (n, q), prior not included."""
        shared = self._shared_part(columns, which)
        return np.block([[self._normal(which), shared], [shared.T, self._within(columns, columns, which)]])

    def _within(self, a: Columns, b: Columns, which: Mask) -> Samples:
        """Products (q, p) before the shared misfit is taken out."""
        found = np.zeros((a.count, b.count))
        for i in np.flatnonzero(which):
            wa, wb, ta, tb = a.white[i], b.white[i], a.taken[i], b.taken[i]
            if wa is not None and wb is not None and ta is not None and tb is not None:
                found += wa.T @ wb - ta.T @ tb
        return found

    def _shared_part(self, c: Columns, which: Mask) -> Samples:
        """Products (k, q) of the base's columns, one deviation each, with others."""
        found = np.zeros((len(self.shared), c.count))
        for i in np.flatnonzero(which):
            of_record = c.shared[i]
            if of_record is not None:
                found += of_record
        return np.asarray(self.shared.T @ found)

    def _factor(self, which: Mask) -> tuple[Samples, bool]:
        key = which.tobytes()
        if key not in self._solved:
            self._solved[key] = cho_factor(self._normal(which))
        return self._solved[key]

    def _normal(self, which: Mask) -> Samples:
        """Information (k, k) about the shared misfit in deviations, its prior included."""
        normal = sum((self._parts[i].left for i in np.flatnonzero(which)), np.zeros((len(self.shared),) * 2))
        return np.asarray(np.eye(len(normal)) + self.shared.T @ normal @ self.shared)

    def missed(self) -> list[Samples]:
        """Per record (n,), whitened: what the base misses in it by what the reference records say."""
        reference = ~self.changed
        if not reference.any():
            return [np.zeros(len(record.base)) for record in self.records]
        errors = [
            record.modelled.error()[:, None] if r else None for record, r in zip(self.records, reference, strict=True)
        ]
        found = self._shared_part(self.columns(errors), reference)
        amounts = self.shared @ cho_solve(self._factor(reference), found)[:, 0]
        return [record.base @ amounts for record in self.records]


@dataclass(frozen=True)
class _OwnPart:
    """What a record's own misfit takes of columns."""

    root: Samples
    """(k, k) which takes products of the base's columns with others to what its own misfit takes of these."""
    cross: Samples
    """(k, k) what it takes of the base's columns, transposed."""
    left: Samples
    """(k, k) products of the base's columns with each other, the own misfit taken out."""

    def split(self, products: Samples) -> tuple[Samples, Samples]:
        """From the products (k, q) of the base's columns with others: what it takes of these, and the products without
        that."""
        taken = self.root @ products
        return taken, products - self.cross @ taken


def _own_part(base: Samples, own: Samples) -> _OwnPart:
    normal = base.T @ base
    factor = cholesky(np.eye(len(own)) + own.T @ normal @ own, lower=True)
    root = solve_triangular(factor, own.T, lower=True)
    cross = normal @ root.T
    return _OwnPart(root, cross, normal - cross @ cross.T)


def compact(records: Sequence[SpaceRecord], shared: Samples, own: Samples, least: float) -> Space:
    """The space of records whose base columns have the deviations ``shared`` and ``own`` (k,): columns that are
    combinations of others are joined, those of less than ``least`` whitened squares in all records left out."""
    live = np.flatnonzero(np.maximum(shared, own) > 0)
    shared, own = shared[live], own[live]
    scale = np.maximum(shared, own)
    bases = (record.base[:, live] for record in records)
    power, turn = np.linalg.eigh(scale[:, None] * sum(base.T @ base for base in bases) * scale)
    turn = turn[:, power > least]
    roots = [(turn.T * (deviation / scale)) for deviation in (shared, own)]
    squares = [cholesky(root @ root.T + 1e-12 * np.eye(len(root)), lower=True) for root in roots]
    made_by = np.zeros((records[0].base.shape[1], turn.shape[1]))
    made_by[live] = scale[:, None] * turn
    return Space(tuple(replace(r, base=r.base @ made_by) for r in records), squares[0], squares[1], made_by)


FIRST_SHARED, FIRST_OWN = 1.0, 0.05
"""Deviations of base columns before anything is known, in prior units: shared by all records, and a record's own."""
PRIOR_SHARED, PRIOR_OWN, PRIOR_COUNT = 0.05, 0.02, 2.0
"""Where the records say nothing of a group, its deviations tend to these, believed as much as so many columns."""
ROUNDS = 40
"""Of expectation and maximisation, which then move by less than one per cent."""


def likeliest_spread(
    records: Sequence[SpaceRecord], errors: Sequence[Samples], groups: NDArray[np.intp]
) -> tuple[Samples, Samples]:
    """Deviations (k,) of the shared and of the records' own amounts that make the whitened residuals (n,) of these
    records most likely, one of each for every group of columns (Dempster, Laird and Rubin 1977).
    """
    k, number = len(groups), len(records)
    normals = [record.base.T @ record.base for record in records]
    rights = [record.base.T @ e for record, e in zip(records, errors, strict=True)]
    shared2, own2 = np.full(k, FIRST_SHARED**2), np.full(k, FIRST_OWN**2)
    members = [groups == g for g in np.unique(groups)]
    for _ in range(ROUNDS):
        root = np.sqrt(own2)
        precision, right, inverses = np.diag(1 / shared2), np.zeros(k), []
        for normal, r in zip(normals, rights, strict=True):
            inverse = root[:, None] * np.linalg.inv(np.eye(k) + root[:, None] * normal * root) * root
            inverses.append(inverse)
            precision += normal - normal @ inverse @ normal
            right += r - normal @ (inverse @ r)
        spread = np.linalg.inv(precision)
        mean = spread @ right
        second_shared, second_own = mean**2 + np.diag(spread), np.zeros(k)
        for normal, r, inverse in zip(normals, rights, inverses, strict=True):
            shift = inverse @ (r - normal @ mean)
            through = inverse @ normal
            second_own += shift**2 + np.diag(inverse) + ((through @ spread) * through).sum(axis=1)
        for m in members:
            shared2[m] = (second_shared[m].sum() + PRIOR_COUNT * PRIOR_SHARED**2) / (m.sum() + PRIOR_COUNT)
            own2[m] = (second_own[m].sum() + PRIOR_COUNT * PRIOR_OWN**2) / (number * m.sum() + PRIOR_COUNT)
    return np.sqrt(shared2), np.sqrt(own2)
