"""How much offsets between records count, and moments of records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.identify.operator.regressors import FitRun, nested_basis
from phaselead.identify.operator.solution import (
    LEAST_OFFSET_WEIGHT,
    Solution,
    centred,
    moments,
    of_records,
    together,
    weight_of_offsets,
)
from phaselead.identify.runs import AxisRun

BASIS = nested_basis(8.0, -1.0, 6.0, 5, 4)


def fit_of(rows: int, group: int, seed: int) -> FitRun:
    """A record of noise, in three groups."""
    rng = np.random.default_rng(seed)
    u, x = np.cumsum(rng.normal(size=rows)) / 5, rng.normal(size=rows)
    run = AxisRun(np.arange(rows) * 1e-3, u, x, slice(None), "x", "made.csv")
    return FitRun(run, np.arange(rows, dtype=np.uintp), group + np.arange(rows) * 3 // rows, 0.5)


FITS = [fit_of(60, 0, 1), fit_of(90, 3, 2)]


def test_moments_of_a_record_are_those_of_its_rows():
    whole = [replace(f, groups=np.full(len(f.rows), i)) for i, f in enumerate(FITS)]
    found = of_records(FITS, moments(FITS, BASIS, 1e-3, 0.3))
    np.testing.assert_allclose(found, moments(whole, BASIS, 1e-3, 0.3), atol=1e-9)


def test_offsets_count_from_not_at_all_to_as_any_residual():
    each = of_records(FITS, moments(FITS, BASIS, 1e-3, 0.3))
    own, common = centred(each).sum(axis=0), centred(each.sum(axis=0))
    np.testing.assert_allclose(together(each, 0.0), own, atol=1e-9)
    np.testing.assert_allclose(together(each, 1.0), common, atol=1e-9)
    np.testing.assert_allclose(together(each, 0.25), 0.75 * own + 0.25 * common, atol=1e-9)


SHARES = st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=5)


@given(SHARES, SHARES, st.floats(1.0, 100.0))
def test_the_more_offsets_scatter_the_less_they_count(offsets, shapes, factor):
    weight = weight_of_offsets(offsets, shapes)
    assert LEAST_OFFSET_WEIGHT <= weight <= 1
    assert weight_of_offsets([factor * offset for offset in offsets], shapes) <= weight
    assert weight_of_offsets(offsets, [factor * shape for shape in shapes]) >= weight
    assert weight_of_offsets([0.0], shapes) == 1


@pytest.mark.parametrize("turned_V", [(), (4.0,), (5.0, -1.0)])
def test_what_is_left_after_other_turns_is_worked_out_from_one(turned_V):
    found = Solution(BASIS, 1e-3, 0.3, np.linspace(0.1, 1.0, BASIS.size), 0.2, 0.0)
    left_um = found.residuals_of(FITS[0])(turned_V)
    np.testing.assert_allclose(left_um, found.residual(replace(FITS[0], turned_V=turned_V)), atol=1e-9)


def test_the_start_of_a_record_has_rows_as_dense_as_the_rest():
    fit = FITS[0]
    late = replace(fit, rows=fit.rows[20::2], groups=fit.groups[20::2])
    whole = late.with_start()
    assert whole.rows.tolist() == list(range(0, 60, 2))
    assert len(whole.groups) == len(whole.rows)
    windowed = replace(late, run=replace(fit.run, scored=slice(10, None))).with_start()
    assert windowed.rows[0] == 10
