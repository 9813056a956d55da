"""Decoupling: coupled again, what comes out is what went in, for every set of axes that moves."""

import ctypes as ct

import numpy as np
import pytest
from core_bindings import I32, Decoupling, any_i32, whole
from hypothesis import given
from hypothesis import strategies as st

ONE = 1 << 28
ROWS = (ct.c_int32 * 3) * 3
small = whole(-ONE // 4, ONE // 4)


def matrix(values):
    return ROWS(*[(ct.c_int32 * 3)(*row) for row in values])


@st.composite
def couplings(draw, entries=small):
    return [[ONE if i == j else draw(entries) for j in range(3)] for i in range(3)]


def apply(core, decoupling, moving, values):
    inout = (I32 * 3)(*values)
    saturated = core.flagged("decouple", decoupling, moving, inout)[1]
    return list(inout), saturated


@given(couplings(), st.integers(0, 7), st.lists(whole(-(2**24), 2**24), min_size=3, max_size=3))
def test_coupled_again_it_is_what_was_asked(core, rows, moving, wanted):
    made = Decoupling()
    assert core.decoupling_make(matrix(rows), made)
    own, saturated = apply(core, made, moving, wanted)
    moves = np.array([moving >> i & 1 for i in range(3)], bool)
    assert not saturated
    assert [v for v, m in zip(own, moves, strict=True) if not m] == [
        v for v, m in zip(wanted, moves, strict=True) if not m
    ]
    seen = np.array(rows) / ONE @ np.where(moves, own, 0)
    assert np.abs(seen - wanted)[moves].max(initial=0) < 2.5


@given(couplings(), st.integers(0, 7), st.lists(whole(-(2**24), 2**24), min_size=3, max_size=3))
def test_what_is_seen_of_motions_is_their_sum_and_decoupled_again_they_are_the_same(core, rows, moving, motions):
    made, seen = Decoupling(), (I32 * 3)(*motions)
    assert core.decoupling_make(matrix(rows), made)
    core.couple(matrix(rows), moving, seen)
    moves = np.array([moving >> i & 1 for i in range(3)], bool)
    expected = np.where(moves, np.array(rows) / ONE @ np.where(moves, motions, 0), motions)
    assert np.abs(np.array(seen) - expected).max() <= 0.5
    own, _ = apply(core, made, moving, list(seen))
    assert np.abs(np.array(own) - motions).max() < 3


@given(couplings(st.one_of(small, whole(-2 * ONE, 2 * ONE))))
def test_every_inverse_is_exact_or_refused(core, rows):
    made = Decoupling()
    taken = core.decoupling_make(matrix(rows), made)
    worst = min(
        np.linalg.det(np.where(np.outer(s, s), np.array(rows) / ONE, np.eye(3)))
        for s in (np.array([k >> i & 1 for i in range(3)], bool) for k in range(8))
    )
    if worst < 1 / 16 - 1e-6 or max(abs(v) for row in rows for v in row) >= 2 * ONE:
        assert not taken
    if taken:
        for k in range(8):
            s = np.array([k >> i & 1 for i in range(3)], bool)
            exact = np.linalg.inv(np.where(np.outer(s, s), np.array(rows) / ONE, np.eye(3)))
            held = np.array([[made.share_q28[k][i][j] for j in range(3)] for i in range(3)])
            assert np.abs(held - exact * ONE).max() <= 8 * max(1, np.abs(exact).max() * 64)


@pytest.mark.parametrize("row", [(ONE - 1, 0, 0), (ONE, 2 * ONE, 0), (ONE, 0, -2 * ONE), (0, ONE, 0)])
def test_rows_that_are_not_taken(core, row):
    assert not core.decoupling_takes((I32 * 3)(*row), 0)
    assert not core.decoupling_make(matrix([row, (0, ONE, 0), (0, 0, ONE)]), Decoupling())


def test_two_axes_that_are_one_have_no_inverse(core):
    assert not core.decoupling_make(matrix([(ONE, ONE, 0), (ONE, ONE, 0), (0, 0, ONE)]), Decoupling())


@given(st.lists(any_i32, min_size=3, max_size=3), st.integers(0, 2**32 - 1))
def test_without_a_model_nothing_is_coupled(core, values, moving):
    assert apply(core, None, moving, values) == (values, False)


def test_what_does_not_fit_is_told(core):
    made = Decoupling()
    assert core.decoupling_make(matrix([(ONE, ONE // 2, 0), (ONE // 2, ONE, 0), (0, 0, ONE)]), made)
    (x, _, _), saturated = apply(core, made, 3, [2**31 - 1, -(2**31), 0])
    assert (x, saturated) == (2**31 - 1, True)
