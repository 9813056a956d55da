"""Moments that are kept apart by whose columns they are give what one dense matrix of all columns gives."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from phaselead.gap.posterior.moments import Amounts, Moments, SharedProducts

SETTINGS = 3
"""Ways to weigh the blocks at a time."""


@dataclass
class Drawn:
    """Columns of some records as one dense matrix, of which each record's own are 0 in the others, and as moments."""

    moments: Moments
    dense: np.ndarray
    """(blocks, p + k + runs b + 1, ...) mean products of everything, the residual last."""
    weights: np.ndarray
    precision: np.ndarray

    @property
    def dense_priors(self):
        p = len(self.precision)
        return np.diag(np.append(self.precision, np.ones(self.dense.shape[1] - 1 - p)))

    def normals(self):
        return [np.tensordot(w, self.dense, 1)[:-1, :-1] + self.dense_priors for w in self.weights]

    def rights(self):
        return [np.tensordot(w, self.dense, 1)[:-1, -1:] for w in self.weights]


@st.composite
def drawn(draw):
    p, k, b, runs = (draw(st.integers(low, 4)) for low in (0, 0, 0, 1))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sizes = [rng.integers(1, 6, size=rng.integers(1, 5)) for _ in range(runs)]
    scale = 10 ** rng.uniform(-2, 2, size=p + k + b + 1)
    own, across, among, dense = [], [], [], []
    for run, rows in enumerate(sizes):
        for n in rows:
            x = rng.normal(size=(n, p + k + b + 1)) * scale
            mine = np.concatenate([x[:, :p], x[:, p + k :]], axis=1)
            shared = x[:, p : p + k]
            everything = np.zeros((n, p + k + runs * b + 1))
            everything[:, : p + k], everything[:, -1] = x[:, : p + k], x[:, -1]
            everything[:, p + k + run * b : p + k + (run + 1) * b] = x[:, p + k : -1]
            for found, left, right in (
                (own, mine, mine), (across, mine, shared), (among, shared, shared), (dense, everything, everything),
            ):  # fmt: skip
                found.append(left.T @ right / n)
    first = [0, *np.cumsum([len(rows) for rows in sizes]).tolist()]
    moments = Moments(np.stack(own), np.stack(across), SharedProducts(np.stack(among)), first, p, np.ones((runs, b)))
    weights = rng.exponential(size=(SETTINGS, first[-1]))
    return Drawn(moments, np.stack(dense), weights, rng.exponential(size=p))


def column(amounts):
    """One dense column (p + k + runs b, m) for each of the settings."""
    s, runs, b, m = amounts.before.shape
    return np.concatenate([amounts.common, amounts.before.reshape(s, runs * b, m)], axis=1)


def some(moments, zeros=0, m=1, seed=0):
    rng, none = np.random.default_rng(seed), moments.none(SETTINGS).behind(zeros)
    return Amounts(*(rng.normal(size=(*part.shape[:-1], m)) for part in (none.common, none.before)))


@given(drawn())
def test_the_power_that_is_left_is_that_of_the_dense_matrix(case):
    amounts = some(case.moments)
    with_residual = np.pad(-column(amounts.behind(len(case.precision)))[..., 0], ((0, 0), (0, 1)), constant_values=1.0)
    exact = np.einsum("si,bij,sj->sb", with_residual, case.dense, with_residual)
    size = np.einsum("si,bij,sj->sb", abs(with_residual), abs(case.dense), abs(with_residual))
    assert np.all(abs(case.moments.power(amounts) - exact) <= 1e-12 * size)


@given(drawn())
def test_normal_equations_are_those_of_the_dense_matrix(case):
    p, m = len(case.precision), 2
    normal, right = case.moments.normal(case.weights, case.precision)
    amounts = some(case.moments, p, m)
    for i, (dense, of_residual) in enumerate(zip(case.normals(), case.rights(), strict=True)):
        np.testing.assert_allclose(column(right)[i], of_residual, rtol=1e-10, atol=1e-12 * abs(dense).max(initial=1))
        product = dense @ column(amounts)[i]
        np.testing.assert_allclose(column(normal.times(amounts))[i], product, atol=1e-12 * abs(dense).max(initial=1))
        for damping in (0.0, 0.3):
            raised = dense + damping * np.diag(np.diag(dense))
            again = raised @ column(normal.damped(damping).solve(right))[i]
            np.testing.assert_allclose(again, of_residual, rtol=1e-6, atol=1e-9 * abs(of_residual).max(initial=0))
        np.testing.assert_allclose(normal.log_determinant[i], np.linalg.slogdet(dense)[1], rtol=1e-8, atol=1e-8)
        c = normal.common.shape[1]
        np.testing.assert_allclose(np.linalg.inv(normal.reduced[i]), np.linalg.inv(dense)[:c, :c], rtol=1e-6, atol=1e-9)


@given(drawn())
def test_products_along_columns_are_summed_over_all_of_them(case):
    left, right = some(case.moments, 0, 2, seed=1), some(case.moments, 0, 3, seed=2)
    exact = np.einsum("scm,scq->smq", column(left), column(right))
    np.testing.assert_allclose(left.along(right), exact, atol=1e-12)


@given(drawn(), st.integers(0, 2**32 - 1))
def test_another_residual_changes_its_own_products_alone(case, seed):
    """As if it had been among the columns from the beginning."""
    rng, p = np.random.default_rng(seed), len(case.precision)
    own = rng.normal(size=(len(case.dense), case.moments.own.shape[1] - p))
    across = rng.normal(size=(len(case.dense), case.moments.shared.size))
    found, before = case.moments.with_residual(own, across), case.moments.integrated
    np.testing.assert_array_equal(found.own[:, -1], own)
    np.testing.assert_array_equal(found.own, found.own.transpose(0, 2, 1))
    np.testing.assert_array_equal(found.own[:, :-1, :-1], before.own[:, :-1, :-1])
    np.testing.assert_array_equal(found.across[:, :-1], before.across[:, :-1])
    np.testing.assert_array_equal(found.across[:, -1], across)
    assert found.tangents == 0


@given(drawn())
def test_weighing_in_several_ways_at_a_time_is_weighing_one_by_one(case):
    several, _ = case.moments.normal(case.weights, case.precision)
    for i, weights in enumerate(case.weights):
        one, _ = case.moments.normal(weights[None], case.precision)
        for all_parts, part in (
            (several.common, one.common),
            (several.beside, one.beside),
            (several.before, one.before),
        ):
            np.testing.assert_allclose(all_parts[i], part[0], rtol=1e-12, atol=1e-12 * abs(part).max(initial=0))


def test_blocks_of_each_record_are_its_own():
    """The columns of one record are not eliminated by the blocks of another."""
    own = np.array([np.eye(2), 4 * np.eye(2), 9 * np.eye(2)])
    moments = Moments(own, np.zeros((3, 2, 0)), SharedProducts(np.zeros((3, 0, 0))), [0, 2, 3], 0, np.ones((2, 1)))
    normal, _ = moments.normal(np.ones((1, 3)), np.zeros(0))
    np.testing.assert_array_equal(normal.before[0, :, 0, 0], [1 + 1 + 4, 1 + 9])
    assert [b - a for a, b in pairwise(moments.runs)] == [2, 1]


@given(drawn(), st.integers(0, 2**32 - 1))
def test_a_column_that_does_not_count_changes_nothing(case, seed):
    """Whatever its amount, and whatever the records say of it."""
    moments = case.moments
    moving = np.random.default_rng(seed).integers(0, 2, size=moments.moving.shape).astype(float)
    found = moments.where_moving(moving)
    amounts = some(moments)
    kept = Amounts(amounts.common, amounts.before * moving[:, :, None])
    np.testing.assert_allclose(found.power(amounts), moments.power(kept), rtol=1e-9, atol=1e-12)
    normal, right = found.normal(case.weights, case.precision)
    solved = normal.solve(right)
    assert not (solved.before * (1 - moving)[:, :, None]).any()
