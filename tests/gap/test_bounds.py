"""A bound of what is absent holds its true size, on toy records drawn from the model itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy import GAIN, Toy, sized

from phaselead.gap.bounds import _largest, largest_sizes
from phaselead.gap.posterior.contest import Contest
from phaselead.gap.posterior.equation_misfit import TIMES_BASE
from phaselead.gap.posterior.shapes import Shapes
from phaselead.gap.posterior.starts import SizedGroup, Starts
from phaselead.gap.regressors import RegressorGroup, typical_sizes
from phaselead.model import catalogue

(SIZE,) = GAIN.sizes
NINE_RECORDS = ("train",) * 6 + ("holdout",) * 3


def bound(likelihood):
    """Of the gain beside nothing, in typical sizes."""
    starts, nothing = Starts(likelihood, [GAIN]), likelihood.fit(())
    columns = [run.coefficients(run.modelled.columns[GAIN.name][:, None]) * run.changed for run in likelihood.runs]
    group = RegressorGroup(GAIN, {}, typical_sizes(GAIN))
    starts.shapes = Shapes([group], [one.astype(np.float32) for one in columns])
    contest = Contest(likelihood, {(): nothing}, starts)
    return largest_sizes(contest, nothing, [GAIN])[GAIN.name] / SIZE.typical


def test_it_holds_the_truth_in_95_of_100_draws_where_the_base_misses_the_same_in_all_records():
    """What is missed looks most like the effect."""
    rng, held, draws = np.random.default_rng(0), 0, 300
    for seed in range(draws):
        truth, times = float(rng.uniform(-0.05, 0.05)), float(rng.choice(TIMES_BASE))
        toy = Toy(seed, [sized(truth)], 0.0, times, 50.0, NINE_RECORDS, like_effect=True, rows=128, in_all=True)
        held += abs(truth) <= bound(toy.likelihood)
    assert held / draws > 0.92


def test_records_that_repeat_others_lower_no_bound_that_the_misfit_sets():
    toy = Toy(0, [sized(0.0)], 0.0, 1.0, 50.0, ("train",), like_effect=True)
    (run,), shared = toy.likelihood.runs, toy.likelihood.shared
    once, often = (bound(replace(toy.likelihood, runs=(run,) * n, shared=shared * n)) for n in (1, 6))
    assert often > 0.7 * once


def test_records_with_noise_of_their_own_lower_it():
    roles = ("train",) * 6
    many = Toy(0, [sized(0.0)], 0.0, 0.0, 1e4, roles)
    silent = replace(many.likelihood.expected, share=np.zeros_like(many.likelihood.expected.share))
    among = replace(many.likelihood, expected=silent)
    alone = replace(among, runs=among.runs[:1], shared=among.shared[:1])
    assert bound(among) < 0.7 * bound(alone)


def sized_at(**said):
    """What records say of a size at some values, by the value in typical sizes: amount and deviation, in that value."""
    groups = {at: RegressorGroup(GAIN, {}, (float(at[1:]) * SIZE.typical,)) for at in said}
    return [SizedGroup(groups[at], *said[at]) for at in said]


def test_what_shows_nothing_until_it_is_large_is_bounded_by_what_would_have_shown():
    """A rail that the records do not come near, and one a little further in that they would have met: a typical one
    would change hardly a row, and a straight line from there was a bound of its own making."""
    silent = (0.0, np.inf)
    assert _largest(sized_at(x1=silent, x2=silent, x8=(0.0, 0.1))) == 8 * SIZE.typical
    assert _largest(sized_at(x1=(0.2, 0.9), x2=silent, x8=silent)) == np.inf
    assert _largest(sized_at(x1=(0.2, 0.9), x2=(0.9, 0.1), x8=(0.0, 0.1))) > 2 * SIZE.typical


def test_between_a_size_that_may_be_there_and_one_that_may_not_neither_says_what_is():
    """A rail at 6.3 V: one at 7 V explains a part of what is left, one at 6 V nothing, and 0.18 of the range was the
    bound of what is 0.21."""
    ladder = sized_at(x1=(0.2, 0.7), x2=(0.76, 0.35), x4=(0.1, 0.07))
    assert _largest(ladder) == 4 * SIZE.typical
    as_linear = sized_at(x2=(0.76, 0.35), x4=(0.38, 0.175))
    assert _largest(as_linear) == pytest.approx(_largest(sized_at(x2=(0.76, 0.35))))


def test_what_another_size_may_take_is_the_same_at_whatever_size_it_was_simulated():
    """Its prior is in typical sizes. Of a rail simulated at a sixteenth of one the other was held to nearly nothing."""
    saturation = catalogue()["saturation"]
    toy = Toy(0, [sized(0.0)], 0.0, 0.0, 1e4, ("train",) * 3)
    starts = Starts(toy.likelihood, [saturation])
    steps = [tuple(at * s for s in typical_sizes(saturation)) for at in (0.06, 1.0, 2.5)]
    starts.shapes = Shapes([], [np.zeros((0, 0), np.float32)])
    starts.moments = lambda *_: [  # type: ignore[method-assign]
        (RegressorGroup(saturation, {}, step), np.zeros(2), (step[0] / 0.05) ** 2 * np.array([[4.0, 3.6], [3.6, 4.0]]))
        for step in steps
    ]
    found = starts.sizes(toy.likelihood.fit(()))
    assert np.ptp([one.deviation * one.group.steps[0] for one in found]) < 1e-6


@given(st.floats(-2, 2), st.floats(0.01, 2.0))
def test_a_bound_of_what_is_linear_is_the_same_wherever_it_was_simulated(amount, deviation):
    ladder = {f"x{at}": (amount / at, deviation / at) for at in (0.06, 0.25, 1, 2.5)}
    alone = _largest(sized_at(x1=(amount, deviation)))
    assert _largest(sized_at(**ladder)) == pytest.approx(alone)
