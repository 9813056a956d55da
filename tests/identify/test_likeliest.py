"""What records hardly show of an operator is not guessed from a few of their rows."""

from __future__ import annotations

import numpy as np
import pytest
from bench_stage import record

from phaselead.identify.operator.likeliest import likeliest_slopes
from phaselead.identify.operator.regressors import nested_basis, rows_to_fit
from phaselead.identify.operator.solution import best_slopes
from phaselead.identify.runs import axis_run

GAIN_UM_PER_V, TOP_V, RATE_HZ = 10.0, 8.0, 500.0
REST = 0.999
"""A play of half of the swing then moves in the uppermost 0.1 % of it alone."""


def runs(missed_um, seed):
    """Triangles of two levels, and what an operator misses of them: slow waves, and creep once the stage was at the
    top."""
    rng, found = np.random.default_rng(seed), []
    t_s = np.arange(4000) / RATE_HZ
    for level in (0.6, 1.0):
        u = level * TOP_V * (1 - np.abs(1 - (t_s % 2.0)))
        waves = sum(np.sin(2 * np.pi * f * t_s + p) for f, p in rng.uniform(0.5, 6, size=(4, 2)))
        x = (
            GAIN_UM_PER_V * u
            + missed_um * (waves / 2 + 2 * (np.maximum.accumulate(u) > 0.9985 * TOP_V))
            + 0.001 * rng.normal(size=len(t_s))
        )
        found.append(rows_to_fit(axis_run(record(t_s, u, x), "x"), 2000, len(found), 1))
    return found


def fitted(missed_um, seed=0):
    """As least squares has it, and the likeliest."""
    fits = runs(missed_um, seed)
    least = best_slopes(fits, nested_basis(TOP_V, 0.0, TOP_V, 12, 4), 0.0, REST, False)
    return least, likeliest_slopes(fits, least, False)


@pytest.mark.parametrize("seed", range(5))
def test_a_play_that_hardly_moves_does_not_outweigh_the_stage(seed):
    """Beyond its voltages the stage would go on at that weight beside its gain."""
    least, likeliest = fitted(0.05, seed)
    last = least.basis.n_segments + least.basis.n_plays - 1
    assert least.slopes[last] > 2 * GAIN_UM_PER_V
    assert likeliest.slopes[last] < 0.6 * GAIN_UM_PER_V
    assert likeliest.error < 1.3 * least.error


@pytest.mark.parametrize("seed", range(5))
def test_what_records_show_stays_as_it_is(seed):
    """As they show it better, what is likely beforehand counts less."""
    apart = []
    for missed_um in (0.05, 0.0):
        least, likeliest = fitted(missed_um, seed)
        n = least.basis.n_segments
        np.testing.assert_allclose(likeliest.slopes[:n], least.slopes[:n], atol=0.02 * GAIN_UM_PER_V)
        apart.append(float(np.abs(likeliest.slopes[:n] - least.slopes[:n]).max()))
    assert apart[1] < apart[0]
    assert apart[1] < 1e-3 * GAIN_UM_PER_V
