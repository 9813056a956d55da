"""Whether a model saves held-out squares beyond chance."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace as Made

import numpy as np
import pytest

from phaselead.gap.error_rates import ERROR_RATE
from phaselead.gap.residual import ModelledRun
from phaselead.gap.savings import probability_by_chance, saved_by_block, shares_saved

ROWS, STEP_S = 4000, 1e-3


def a_run(error, added=0.0):
    """A run whose error is ``error`` (n,), and ``added`` (n,) more for every effect in the model."""
    run = Made(start=0, stop=len(error), step_s=STEP_S)
    made = Made(run=run, period_rows=None, error=lambda entries: error + len(entries) * added)
    made.error_about_mean = partial(ModelledRun.error_about_mean, made)
    return made


def test_its_rate_of_false_alarms_is_the_stated_one():
    rng = np.random.default_rng(0)
    draws = [probability_by_chance(rng.normal(size=12)) for _ in range(4000)]
    for level in (ERROR_RATE, 0.1, 0.5):
        rate = float(np.mean(np.array(draws) < level))
        assert rate == pytest.approx(level, abs=4 * np.sqrt(level / 4000))


def test_a_saving_in_every_block_is_no_chance_and_a_loss_is():
    rng = np.random.default_rng(1)
    saved = 1.0 + 0.2 * rng.normal(size=12)
    assert probability_by_chance(saved) < 1e-6
    assert probability_by_chance(-saved) > 0.999
    assert probability_by_chance(np.array([5.0])) == 1.0  # one block tells nothing of chance
    assert probability_by_chance(np.zeros(5)) == 1.0
    assert probability_by_chance(np.ones(12)) == 0.0  # all of every block is saved
    assert probability_by_chance(-np.ones(12)) == 1.0


def test_each_block_says_as_much_where_one_holds_nearly_all_of_the_squares():
    rng = np.random.default_rng(2)
    was = 1.0 + rng.uniform(size=12)
    was[3] = 1e4  # it rings
    now = 0.1 * was * rng.uniform(0.5, 1.5, 12)
    assert probability_by_chance(was - now) > ERROR_RATE
    assert probability_by_chance(shares_saved(was, now)) < ERROR_RATE
    assert probability_by_chance(shares_saved(was, np.zeros(12))) == 0.0
    nothing = was * rng.uniform(0.99, 1.01, 12)
    nothing[3] = 1.0  # of one block alone chance may save as much
    assert probability_by_chance(shares_saved(was, nothing)) > ERROR_RATE
    assert not shares_saved(np.zeros(3), np.zeros(3)).any()


def test_what_is_saved_is_the_difference_of_squares_about_each_mean():
    rng = np.random.default_rng(2)
    errors = [rng.normal(size=n) + 100.0 for n in (ROWS, ROWS // 2)]
    runs = [a_run(error, -0.5 * error) for error in errors]
    saved = saved_by_block(runs, (), runs, ("one",))
    assert saved.sum() == pytest.approx(0.75 * sum(float(np.sum((e - e.mean()) ** 2)) for e in errors))
    assert len(saved) > 10
    assert saved_by_block(runs, (), runs, ()) == pytest.approx(np.zeros(len(saved)))


def test_effects_of_no_use_save_nothing_beyond_chance():
    found = []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        error, useless = rng.normal(size=(2, 1000))
        model = a_run(error, 0.1 * useless)
        found.append(probability_by_chance(saved_by_block([model], (), [model], ("one",))))
    assert np.mean(np.array(found) < ERROR_RATE) < 0.01  # what is useless adds its own squares
