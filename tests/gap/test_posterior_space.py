"""The algebra of the space against the same written out: dense covariances, records drawn from known deviations."""

from __future__ import annotations

from types import SimpleNamespace as Made

import numpy as np
import pytest

from phaselead.gap.posterior.space import Space, SpaceRecord, compact, joined, likeliest_spread

ROWS = (30, 17, 25)
ROLES = ("reference", "train", "holdout")


def bare_record(base, role="train"):
    """A record of a space whose columns are white already."""
    metric = Made(project=lambda index, columns: columns.copy())
    return SpaceRecord(Made(run=Made(role=role)), metric, 0, base)


def made_space(rng, k=6, own=True):
    records = tuple(bare_record(rng.normal(size=(n, k)), role) for n, role in zip(ROWS, ROLES, strict=True))
    own_root = 0.3 * rng.normal(size=(k, k)) if own else np.zeros((k, k))
    return Space(records, rng.normal(size=(k, k)), own_root, np.eye(k))


def dense_covariance(space, which):
    """Of all rows of the records ``which``, one below the other: noise, what they share, and what each has alone."""
    kept = [record.base for record, wanted in zip(space.records, which, strict=True) if wanted]
    every = np.concatenate(kept)
    covariance = np.eye(len(every)) + every @ space.shared @ space.shared.T @ every.T
    start = 0
    for base in kept:
        rows = slice(start, start + len(base))
        covariance[rows, rows] += base @ space.own @ space.own.T @ base.T
        start += len(base)
    return covariance


def stacked(columns, which):
    return np.concatenate([w for w, wanted in zip(columns, which, strict=True) if wanted])


@pytest.mark.parametrize("own", [True, False])
@pytest.mark.parametrize("which", [(1, 1, 1), (1, 1, 0), (0, 1, 0), (1, 0, 1)])
def test_a_product_is_that_under_the_whole_covariance(own, which):
    rng, which = np.random.default_rng(1), np.array(which, dtype=bool)
    space = made_space(rng, own=own)
    a, b = ([rng.normal(size=(n, q)) for n in ROWS] for q in (3, 2))
    expected = stacked(a, which).T @ np.linalg.solve(dense_covariance(space, which), stacked(b, which))
    np.testing.assert_allclose(space.inner(space.columns(a), space.columns(b), which), expected, rtol=1e-9, atol=1e-10)


def test_columns_that_a_record_has_not_are_zero_there():
    rng = np.random.default_rng(2)
    space = made_space(rng)
    a, b = ([rng.normal(size=(n, 2)) for n in ROWS] for _ in range(2))
    with_gap, with_zeros = [None, *a[1:]], [np.zeros((ROWS[0], 2)), *a[1:]]
    for columns in (with_gap, with_zeros):
        found = space.inner(space.columns(columns), space.columns(b), space.all)
        expected = stacked(with_zeros, space.all).T @ np.linalg.solve(
            dense_covariance(space, space.all), stacked(b, space.all)
        )
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10)


def test_columns_side_by_side_scaled_and_subtracted_are_those_of_the_same_arrays():
    rng = np.random.default_rng(3)
    space = made_space(rng)
    a, b = ([rng.normal(size=(n, 2)) for n in ROWS] for _ in range(2))
    amounts = rng.normal(size=(2, 2))
    of_a, of_b = space.columns(a), space.columns(b)
    pairs = (
        (joined(of_a, of_b), [np.concatenate(both, axis=1) for both in zip(a, b, strict=True)]),
        (of_a.scaled(-1.7), [-1.7 * one for one in a]),
        (of_a.minus(of_b, amounts), [one - other @ amounts for one, other in zip(a, b, strict=True)]),
    )
    for found, arrays in pairs:
        expected = space.columns(arrays)
        np.testing.assert_allclose(
            space.inner(found, of_b, space.all), space.inner(expected, of_b, space.all), atol=1e-10
        )


def test_roles_say_which_records_are_changed_and_which_were_fitted():
    space = made_space(np.random.default_rng(4))
    assert space.changed.tolist() == [False, True, True]
    assert space.fitted.tolist() == [True, True, False]


def test_what_the_base_misses_is_learned_from_the_reference_records_alone():
    rng = np.random.default_rng(5)
    k, amounts = 3, np.array([1.0, -2.0, 0.5])
    bases = [rng.normal(size=(200, k)) for _ in ROLES]
    records = []
    for base, role in zip(bases, ROLES, strict=True):
        error = base @ amounts if role == "reference" else rng.normal(size=200) * 100
        records.append(bare_record(base, role))
        records[-1].modelled.error = lambda error=error: error
    missed = Space(tuple(records), 3 * np.eye(k), np.zeros((k, k)), np.eye(k)).missed()
    for base, one in zip(bases, missed, strict=True):
        np.testing.assert_allclose(one, base @ amounts, atol=0.05 * np.abs(base @ amounts).max())


def test_compact_leaves_out_what_no_product_shows():
    rng, least = np.random.default_rng(6), 0.05
    k = 12
    size = np.logspace(-3, 1, k) / np.sqrt(sum(ROWS))
    bases = [rng.normal(size=(n, k)) * size for n in ROWS]
    for base in bases:
        base[:, 3] = 2 * base[:, 4]  # one is a combination of others
    shared, own = rng.uniform(0.5, 1, k), rng.uniform(0, 0.5, k)
    shared[7] = own[7] = 0.0
    whole = Space(tuple(bare_record(base) for base in bases), np.diag(shared), np.diag(own), np.eye(len(shared)))
    small = compact(whole.records, shared, own, least)
    assert small.records[0].base.shape[1] < k - 2
    units = np.split(np.eye(sum(ROWS)), np.cumsum(ROWS)[:-1])
    before, after = (s.inner(s.columns(units), s.columns(units), s.all) for s in (whole, small))
    # The largest change of any product of columns of unit length.
    assert np.abs(np.linalg.eigvalsh(before - after)).max() < 2 * least
    exact = compact(whole.records, shared, own, 1e-12)
    again = exact.inner(exact.columns(units), exact.columns(units), exact.all)
    np.testing.assert_allclose(again, before, atol=1e-6)


def test_the_likeliest_deviations_are_those_that_the_records_were_drawn_with():
    rng = np.random.default_rng(7)
    groups = np.repeat([0, 1], 50)
    shared, own = np.where(groups == 0, 0.5, 0.03), np.where(groups == 0, 0.05, 0.3)
    w = rng.normal(size=100) * shared
    records = [bare_record(rng.normal(size=(400, 100))) for _ in range(8)]
    errors = [r.base @ (w + rng.normal(size=100) * own) + rng.normal(size=400) for r in records]
    found_shared, found_own = likeliest_spread(records, errors, groups)
    assert (np.ptp(found_shared[:50]), np.ptp(found_own[50:])) == (0.0, 0.0)  # one of each for a group
    assert found_shared[0] == pytest.approx(0.5, rel=0.25)
    assert found_own[0] == pytest.approx(0.05, rel=0.35)
    assert found_own[-1] == pytest.approx(0.3, rel=0.1)
    assert found_shared[-1] < 0.12  # hidden under the records' own


def test_deviations_of_which_the_records_say_nothing_tend_to_their_prior():
    records = [bare_record(np.zeros((50, 3))) for _ in range(3)]
    errors = [np.random.default_rng(i).normal(size=50) for i in range(3)]
    shared, own = likeliest_spread(records, errors, np.zeros(3, dtype=int))
    assert np.all(shared < 0.2)
    assert np.all(own < 0.05)
