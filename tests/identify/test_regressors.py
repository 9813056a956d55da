"""The columns that the fit's kernel makes by skipping rows, against every row of the operator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.identify.operator.regressors import Basis, FitRun, design_matrix, nested_basis, without_idle_plays
from phaselead.identify.operator.solution import Solution, linearised, moments
from phaselead.identify.runs import AxisRun
from phaselead.model import EffectiveField, PlayDensity, behind_modes, modes_in_C
from phaselead.model.operator import delayed, plays

STEP_S = 1e-3
BASIS = nested_basis(8.0, -1.0, 6.0, 5, 4)
# Few distinct voltages: plateaus, repeats and jumps are what a search for turning points gets wrong.
VOLTAGES = st.lists(st.sampled_from([-2.0, 0.0, 0.5, 1.0, 1.2, 3.0, 6.5]), min_size=4, max_size=60)


def fit_of(u, rows, turned_V=None, groups=None) -> FitRun:
    u = np.array(u)
    x = np.sin(np.arange(len(u)))
    run = AxisRun(np.arange(len(u)) * STEP_S, u, x, slice(None), "x", "made.csv")
    groups = np.zeros(len(rows), dtype=np.intp) if groups is None else groups
    return FitRun(run, np.array(rows, dtype=np.uintp), groups, 0.5, turned_V)


def every_row(fit: FitRun, delay_s: float, rest_fraction: float, basis: Basis = BASIS) -> np.ndarray:
    """As the operator is defined: segment by segment, play by play, row by row."""
    u, r, turned = fit.run.u_V, basis.play_r_V, fit.turned_V
    rest = rest_fraction * r
    v = delayed(u, delay_s / fit.run.step_s, 0.0 if turned is None else u[0])
    start = rest
    for volt in turned or ():
        start = np.clip(start, volt - r, volt + r)
    moved, _ = plays(v, r, start)
    low, high = basis.knots_V[:-1].copy(), basis.knots_V[1:].copy()
    low[0], high[-1] = -np.inf, np.inf
    through = np.clip(v[:, None], low, high) - np.clip(0.0, low, high)
    return np.concatenate([through, moved - rest], axis=1)[fit.rows]


@settings(deadline=None, max_examples=200)
@given(
    VOLTAGES,
    st.data(),
    st.floats(0.0, 8.0),
    st.floats(-1.0, 1.0),
    st.one_of(st.none(), st.lists(st.sampled_from([-2.0, 1.1, 6.5]), max_size=3).map(tuple)),
)
def test_skipping_rows_changes_nothing(u, data, delay_rows, rest_fraction, turned_V):
    rows = sorted(data.draw(st.sets(st.integers(0, len(u) - 1), min_size=1)))
    fit = fit_of(u, rows, turned_V)
    delay_s = delay_rows * fit.run.step_s
    np.testing.assert_allclose(
        design_matrix(fit, BASIS, delay_s, rest_fraction), every_row(fit, delay_s, rest_fraction), atol=1e-12
    )


MODES = st.lists(
    st.tuples(st.floats(-2.0, 2.0), st.floats(1.0, 450.0), st.floats(0.002, 0.9)), min_size=1, max_size=3
).map(tuple)


@settings(deadline=None, max_examples=400)
@given(
    VOLTAGES,
    st.data(),
    st.one_of(st.floats(0.0, 8.0), st.just(1e4)),
    st.floats(-1.0, 1.0),
    st.one_of(st.none(), st.lists(st.sampled_from([-2.0, 1.1, 6.5]), max_size=3).map(tuple)),
    MODES,
    st.sampled_from([(5, 4), (0, 4), (5, 1), (0, 1), (1, 2)]),
)
def test_modes_ring_of_what_every_row_did(u, data, delay_rows, rest_fraction, turned_V, modes, size):
    rows = sorted(data.draw(st.sets(st.integers(0, len(u) - 1), min_size=1)))
    delay_s, basis = delay_rows * STEP_S, nested_basis(8.0, -1.0, 6.0, *size)
    whole = every_row(fit_of(u, range(len(u)), turned_V), delay_s, rest_fraction, basis)
    found = design_matrix(fit_of(u, rows, turned_V), basis, delay_s, rest_fraction, modes)
    np.testing.assert_allclose(found, behind_modes(whole, modes, STEP_S)[rows], rtol=0, atol=1e-9)


@pytest.mark.parametrize("zeta", [0.005, 0.3])
def test_a_long_record_rings_the_same_at_the_few_rows_that_count(zeta):
    t_s = np.arange(20_000) * STEP_S
    u = 2 + 3 * np.sin(2 * np.pi * 0.7 * t_s) + 0.8 * np.sin(2 * np.pi * 11 * t_s) + (t_s > 7)
    rows, modes = np.arange(3_000, len(u), 211), ((1.0, 97.0, zeta), (-0.3, 310.0, 0.02))
    whole = every_row(fit_of(u, range(len(u)), ()), 1.7e-3, 0.3)
    found = design_matrix(fit_of(u, rows, ()), BASIS, 1.7e-3, 0.3, modes)
    np.testing.assert_allclose(found, behind_modes(whole, modes, STEP_S)[rows], rtol=0, atol=1e-12)


@pytest.mark.parametrize("lag_s", [0.0, 2e-3])
@pytest.mark.parametrize("bend", [0.0, 0.2])
def test_modes_are_behind_lag_and_field(lag_s, bend):
    u = 2 + 3 * np.sin(np.arange(300) / 17)
    fit = replace(fit_of(u, range(0, 300, 7), ()), lag_s=lag_s, field=EffectiveField(bend, (-1.0, 6.0)))
    still = design_matrix(fit.of_every_row, BASIS, 1e-3, 0.3)
    expected = behind_modes(still, ((0.8, 90.0, 0.05),), STEP_S)[fit.rows]
    np.testing.assert_allclose(design_matrix(fit, BASIS, 1e-3, 0.3, ((0.8, 90.0, 0.05),)), expected, atol=1e-11)


def test_a_mode_of_no_share_carries_nothing():
    fit = fit_of([0.0, 1.0, 5.0, 2.0], range(4))
    still = design_matrix(fit, BASIS, 0.0, 0.3)
    np.testing.assert_allclose(design_matrix(fit, BASIS, 0.0, 0.3, ((0.0, 90.0, 0.1),)), still, atol=1e-12)


def test_idle_plays_add_nothing():
    fading = nested_basis(8.0, -1.0, 6.0, 5, 4, fading=True)
    slopes = np.zeros(fading.size)
    slopes[:4], slopes[5], slopes[-2] = 1.0, 0.3, 0.2
    fit = fit_of([0.0, 3.0, 1.0, 6.0, -1.0], range(5))
    basis, kept = without_idle_plays(fading, slopes)
    assert (basis.n_segments, basis.n_plays, len(basis.fading_r_V)) == (4, 1, 1)
    expected = design_matrix(fit, fading, 1e-3, 0.4) @ slopes
    np.testing.assert_allclose(design_matrix(fit, basis, 1e-3, 0.4) @ kept, expected, atol=1e-12)


def test_plays_that_weigh_unevenly_are_refused_by_the_kernel_of_even_ones():
    uneven = replace(BASIS, density=PlayDensity(0.3, 0.0, (-1.0, 6.0)))
    fit = fit_of([0.0, 1.0, 5.0, 2.0], range(4))
    with pytest.raises(ValueError, match="even"):
        fit._record.fill(np.empty((4, uneven.size + 2)), 0.0, uneven.in_C(0.0), fit._start(uneven, 0.0),
                         modes_in_C(((1.0, 90.0, 0.1),), STEP_S))  # fmt: skip


def test_moments_are_those_of_the_columns_group_by_group():
    rng = np.random.default_rng(1)
    fits = [
        fit_of(rng.uniform(-1, 6, 90), range(0, 90, 2), groups=np.arange(45) * 3 // 45),
        fit_of(rng.uniform(-1, 6, 70), range(70), (2.0,), groups=np.full(70, 2)),
    ]
    found = moments(fits, BASIS, 1.3e-3, 0.4)
    expected = np.zeros_like(found)
    for fit in fits:
        columns = np.column_stack([every_row(fit, 1.3e-3, 0.4), np.ones(len(fit.rows)), fit.position()])
        for group in range(3):
            part = columns[fit.groups == group]
            expected[group] += fit.weight * part.T @ part
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_a_delay_cannot_be_negative():
    with pytest.raises(ValueError, match="future"):
        design_matrix(fit_of([0.0, 1.0, 0.0], [0, 1]), BASIS, -1e-3, 0.0)


@pytest.mark.parametrize("modes", [(), ((0.8, 90.0, 0.05), (-0.2, 210.0, 0.1))])
@pytest.mark.parametrize("fading", [False, True])
def test_the_model_about_a_solution_changes_as_its_columns_say(modes, fading):
    basis = nested_basis(8.0, -1.0, 6.0, 5, 4, fading=fading)
    slopes = np.linspace(1.0, 2.0, basis.size)
    slopes[5] = 0.0
    fit = fit_of(2 + 3 * np.sin(np.arange(300) / 17), range(3, 300, 7), ())
    found = Solution(basis, 2.3e-3, 0.3, slopes, 0.5, 1.0, modes)
    columns, n, step_s = linearised(fit, found, 1e-5), basis.size - 1, 1e-5

    def less(other: Solution) -> np.ndarray:
        return found.residual(fit) - other.residual(fit)

    twice = replace(found, slopes=2 * slopes)
    assert less(twice) == pytest.approx(columns[:, :n] @ slopes[slopes > 0], abs=1e-9)
    assert less(replace(found, delay_s=found.delay_s + step_s)) / step_s == pytest.approx(columns[:, n], abs=1e-6)
    assert less(replace(found, rest_fraction=0.28)) / -0.02 == pytest.approx(columns[:, n + 1], abs=1e-9)
    for i, (share, f_Hz, zeta) in enumerate(modes):
        for k, moved in enumerate([(share + 1e-6, f_Hz, zeta), (share, f_Hz * (1 + 1e-6), zeta),
                                   (share, f_Hz, zeta * (1 + 1e-6))]):  # fmt: skip
            other = replace(found, modes=(*modes[:i], moved, *modes[i + 1 :]))
            column = columns[:, n + 2 + 3 * i + k]
            assert less(other) / 1e-6 == pytest.approx(column, rel=0, abs=1e-3 * np.abs(column).max())
    assert columns[:, -1] == pytest.approx(fit.position())
