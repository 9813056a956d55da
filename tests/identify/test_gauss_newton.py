"""The search that operator and common modes share."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from phaselead.identify.gauss_newton import descend, ridged


def cost(x: float) -> float:
    return 1 + (x - 3) ** 2


def steps(x: float) -> Iterator[float]:
    """First far too far, then a part of the way."""
    for share in (10.0, 0.5, 0.1):
        yield x + share * (3 - x)


def test_a_step_that_raises_the_cost_is_not_taken():
    assert descend(0.0, steps, cost, 1) == 1.5
    assert descend(0.0, steps, cost, 40) == pytest.approx(3.0, abs=1e-6)


def test_steps_stay_untried_once_one_gains():
    tried: list[float] = []

    def noted(x: float) -> Iterator[float]:
        for trial in steps(x):
            tried.append(trial)
            yield trial

    descend(0.0, noted, cost, 1)
    assert tried == [30.0, 1.5]


def test_it_ends_where_steps_gain_too_little():
    # 10 -> 3.25 -> 1.5625 -> 1.140625: a gain of 68, 52 and 27 per cent
    assert descend(0.0, steps, cost, 9, least_gain=0.6) == 1.5
    assert descend(0.0, steps, cost, 9, enough=0.6) == 2.25
    assert descend(0.0, steps, cost, 9, enough=0.6, fewest_steps=3) == 2.625


def test_each_step_is_announced_and_may_be_preceded_by_new_weights():
    shares, numbers = [], []

    def reweighed(x: float, step: int) -> float:
        numbers.append(step)
        return x + 1 if step == 1 else x

    assert descend(0.0, steps, cost, 2, reweighed=reweighed, report=shares.append) == 2.75
    assert (shares, numbers) == ([0.5, 1.0], [0, 1])


def test_a_ridge_makes_any_normal_matrix_invertible():
    normal = np.ones((3, 3))
    assert np.linalg.matrix_rank(ridged(normal, 1e-3)) == 3
    assert ridged(normal, 1e-3)[0, 0] == pytest.approx(1.001)
