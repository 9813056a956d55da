"""What effects know of a signal between its rows."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import LINEAR, MODE, RATE_HZ, axis, run, times
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from phaselead.model.effects.between_rows import nearest_straight, straight
from phaselead.model.effects.slew_limit import slewed

values = st.floats(-10, 10)
fines = st.integers(2, 8)


@given(st.integers(1, 30).flatmap(lambda n: arrays(np.float64, n, elements=values)), fines)
def test_straight_lines_stay_as_they_are(x, fine):
    assert straight(x, fine)[::fine] == pytest.approx(x, abs=1e-12)
    assert nearest_straight(straight(x, fine), fine) == pytest.approx(x, abs=1e-9)


@given(st.integers(1, 12), fines, st.integers(0, 99))
def test_no_straight_lines_come_nearer(n, fine, seed):
    y = np.random.default_rng(seed).normal(size=fine * (n - 1) + 1)
    lines = np.array([straight(row, fine) for row in np.eye(n)]).T
    assert nearest_straight(y, fine) == pytest.approx(np.linalg.lstsq(lines, y, rcond=None)[0], abs=1e-9)


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
    assert 3 * np.std(rows - dense) < np.std(at_rows - dense)


def test_a_delay_bends_no_way_that_is_limited():
    """One of part of a row leaves smaller rates of a way that turns at every row, so it comes behind the limit."""
    u = 4 + 3 * np.random.default_rng(0).uniform(-1, 1, 400)
    part, fine, limit = 0.6, 20, {"traverse_s": 0.008, "loop_s": 0.0}
    late = axis(LINEAR.model_copy(update={"delay_s": part / RATE_HZ}))
    dense = run(late, straight(u, fine), "slew_limit", rate_Hz=fine * RATE_HZ, **limit)[::fine]
    bent = run(axis(LINEAR), np.interp(np.arange(400) - part, np.arange(400), u), "slew_limit", **limit)
    assert 2 * np.std(run(late, u, "slew_limit", **limit) - dense) < np.std(bent - dense)
