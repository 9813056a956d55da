"""What effects know of a signal between its rows."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import LINEAR, MODE, RATE_HZ, axis, run, times
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from phaselead.model.chain import simulate
from phaselead.model.effects import effect
from phaselead.model.effects.between_rows import nearest_straight, straight
from phaselead.model.effects.slew_limit import slewed

values = st.floats(-10, 10)
fines = st.integers(2, 8)


@given(st.integers(1, 30).flatmap(lambda n: arrays(np.float64, n, elements=values)), fines)
def test_straight_lines_stay_as_they_are(x, fine):
    assert straight(x, fine)[::fine] == pytest.approx(x, abs=1e-12)
    assert nearest_straight(straight(x, fine), fine) == pytest.approx(x, abs=1e-9)


@given(st.integers(1, 40), fines, st.integers(0, 99))
def test_rows_stay_within_what_was_between_them(n, fine, seed):
    """And the first stays as it is: so things stood before the record."""
    y = np.random.default_rng(seed).normal(size=fine * (n - 1) + 1)
    rows = nearest_straight(y, fine)
    assert rows[0] == y[0]
    for k in range(n):
        around = y[max(0, (k - 1) * fine) : (k + 1) * fine + 1]
        assert around.min() <= rows[k] <= around.max()


def test_a_corner_between_rows_keeps_more_of_its_area():
    y = np.minimum(np.arange(81) / 8, 5.6)  # the corner lies between rows 5 and 6
    rows = straight(y[::8], 8)
    assert abs((straight(nearest_straight(y, 8), 8) - y).sum()) < 0.6 * abs((rows - y).sum())


@pytest.mark.parametrize("level_V", [3.31, 3.33])
def test_a_memory_behind_the_limit_keeps_nothing_of_it(level_V):
    """A step ends at its voltage and not beyond, as on a finer grid."""
    u, fine = np.concatenate([np.zeros(5), np.full(60, level_V)]), 16
    extra = [(effect("slew_limit"), {"traverse_s": 0.01, "loop_s": 0.0}), (effect("dead_band"), {"width_V": 0.05})]
    rows = simulate(axis(LINEAR), times(65 / RATE_HZ), u, extra=extra)
    dense = simulate(axis(LINEAR), times(65 * fine / RATE_HZ, fine * RATE_HZ), np.repeat(u, fine), extra=extra)
    assert rows[-1] == pytest.approx(dense[-1], abs=0.01)


@pytest.mark.parametrize("f_Hz", [11.3, 17.9, 23.1])
def test_a_mode_behind_a_rate_limit_rings_as_on_a_finer_grid(f_Hz):
    """The limit is left between two rows, where the corner's area is what a mode feels."""
    u = 4 - 4 * np.cos(2 * np.pi * f_Hz * times(0.5))
    traverse_s, fine = 0.05, 16
    rows = run(axis(LINEAR, MODE), u, "slew_limit", traverse_s=traverse_s, loop_s=0.0)
    dense = run(
        axis(LINEAR, MODE), straight(u, fine), "slew_limit", rate_Hz=fine * RATE_HZ, traverse_s=traverse_s, loop_s=0.0
    )[::fine]
    at_rows = run(axis(LINEAR, MODE), slewed(u, 10 / traverse_s / RATE_HZ))
    assert 2 * np.std(rows - dense) < np.std(at_rows - dense)


def test_a_delay_bends_no_way_that_is_limited():
    """One of part of a row leaves smaller rates of a way that turns at every row, so it comes behind the limit."""
    u = 4 + 3 * np.random.default_rng(0).uniform(-1, 1, 400)
    part, fine, limit = 0.6, 20, {"traverse_s": 0.008, "loop_s": 0.0}
    late = axis(LINEAR.model_copy(update={"delay_s": part / RATE_HZ}))
    dense = run(late, straight(u, fine), "slew_limit", rate_Hz=fine * RATE_HZ, **limit)[::fine]
    bent = run(axis(LINEAR), np.interp(np.arange(400) - part, np.arange(400), u), "slew_limit", **limit)
    assert 2 * np.std(run(late, u, "slew_limit", **limit) - dense) < np.std(bent - dense)
