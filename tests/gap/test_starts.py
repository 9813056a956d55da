"""What an effect is expected to bring beside a set, before it is fitted there."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_what_stood_off import LEAK, LEAKS, elsewhere, reference, stood_off

from phaselead.gap.posterior import contest, likelihood_of
from phaselead.gap.posterior.first_order import FirstOrder, Histories
from phaselead.gap.posterior.priors import LARGEST
from phaselead.gap.posterior.sets import Begun
from phaselead.gap.posterior.starts import Starts
from phaselead.model.effects import effect

CREEP, GAIN = effect("creep"), effect("gain_change")


def records(*amounts):
    """A leak in some records before which so much had leaked, in prior deviations."""
    roles = ("train", *["holdout"] * (len(amounts) - 1))
    return likelihood_of([reference(), *map(stood_off, amounts, roles)])


@pytest.mark.parametrize("amounts", [(0.0, 0.0), (0.8, 0.8), (0.8, -0.8)])
def test_of_an_effect_that_explains_all_most_is_expected_of_what_it_brings(amounts):
    """To the set without it the records are outliers, of which each says little: of 240 to 270 log units a leak was
    expected to bring 26, 4 and 1, and was not tried."""
    likelihood = records(*amounts)
    nothing = likelihood.fit(())
    brings = likelihood.fit(LEAKS).log_evidence - nothing.log_evidence
    starts = Starts(likelihood, [LEAK]).beside(nothing)["charge_leakage"]
    assert 0.5 * brings < starts[0].gain < brings + 10
    assert any(start.entry[1]["rate_per_s"] == pytest.approx(0.05, rel=0.25) for start in starts)


EMPTY = ("delay", "sensor_lowpass", "slew_limit", "saturation")
RELAX = ("creep", "softening")


def test_what_cannot_be_there_is_expected_to_bring_nothing():
    """Before rails that would have to lie outside the voltages, and delays below 0, were held to their range, they were
    expected to bring as much as the leak, and stood in front of it."""
    likelihood = records(0.8, -0.8)
    effects = [effect(name) for name in ("charge_leakage", *EMPTY, *RELAX)]
    expected = Starts(likelihood, effects).beside(likelihood.fit(()))
    assert next(iter(expected)) == "charge_leakage"
    for name in EMPTY:
        entry, gain = expected[name][0].entry, expected[name][0].gain
        brings = likelihood.fit([entry]).log_evidence - likelihood.fit(()).log_evidence
        assert gain < max(5.0, brings + 5.0)


@pytest.mark.parametrize("name", RELAX)
def test_what_is_expected_is_what_the_start_brings(name):
    """What creep had done before was taken to go on, by hundreds of prior deviations: of 190 log units it was expected
    to lose 50,000."""
    likelihood = records(0.8, -0.8)
    nothing = likelihood.fit(())
    start = Starts(likelihood, [effect(name)]).beside(nothing)[name][0]
    begun = Begun([start.entry], last_is_over=start.is_over)
    (_, _, there), (_, _, without) = (likelihood.fitted_terms(one, 0) for one in (begun, Begun(())))
    assert start.gain > 100
    assert start.gain == pytest.approx(there - without, abs=10)


def test_an_effect_is_begun_from_different_shapes():
    likelihood = records(0.8, -0.8)
    effects = [effect(name) for name in ("creep", "softening", "hysteresis", "thermal_drift", "asymmetric_hysteresis")]
    for several in Starts(likelihood, effects).beside(likelihood.fit(())).values():
        shapes = [tuple(start.entry[1][p.name] for p in start.entry[0].shapes) for start in several]
        assert len(set(shapes)) == len(shapes) == 2


def test_of_nothing_nothing_is_expected():
    likelihood = likelihood_of([reference(), reference(), stood_off(0.0)])
    fit = likelihood.fit(LEAKS)
    for name, several in Starts(likelihood, [LEAK, CREEP, GAIN]).beside(fit).items():
        assert name != "charge_leakage"
        assert several[0].gain < 5.0


@pytest.mark.parametrize("beside_leak", [False, True])
def test_the_likeliest_amounts_are_those_that_leave_least(beside_leak):
    """Of sizes, of what had been done before each record, and of all that the set does then."""
    likelihood = elsewhere()
    starts, fit = Starts(likelihood, [CREEP, GAIN]), likelihood.fit(LEAKS if beside_leak else ())
    settled = likelihood.settled(fit.terms, [fit.share])
    weights = likelihood.weights(settled.power, settled.variance)[0]
    groups = starts.shapes.groups
    beside = FirstOrder(likelihood, fit.terms, weights, starts.shapes, starts._histories)
    rng = np.random.default_rng(4)

    def cost(which, amounts):
        left, sizes = beside.residual_with(which, amounts), len(groups[which].steps)
        return 0.5 * weights @ left.power - left.log_prior + 0.5 * amounts[:sizes] @ amounts[:sizes] / LARGEST**2

    for which in (0, len(groups) - 1):
        slope, curvature = beside.slope_and_curvature(which)
        assert len(slope) > len(groups[which].steps) or groups[which].effect is GAIN
        precision = np.array([1 / LARGEST**2] * len(groups[which].steps) + [1.0] * len(slope))[: len(slope)]
        likeliest = np.linalg.solve(curvature + np.diag(precision), slope)
        least, none = cost(which, likeliest), cost(which, np.zeros(len(slope)))
        assert none - least == pytest.approx(0.5 * slope @ likeliest, rel=1e-2, abs=1e-2)  # in single precision
        for _ in range(5):
            moved = rng.normal(size=len(slope)) * np.sqrt(np.diag(np.linalg.inv(curvature + np.diag(precision))))
            assert cost(which, likeliest + moved) > least - 1e-6 * abs(least)


@given(st.lists(st.lists(st.integers(0, 3), min_size=3, max_size=3), min_size=1, max_size=4), st.data())
@settings(max_examples=50)
def test_every_column_has_one_place(widths, data):
    sizes = data.draw(st.lists(st.integers(1, 3), min_size=3, max_size=3))
    histories = Histories([[np.zeros((2, width)) for width in of_run] for of_run in widths])
    of_groups = histories.behind(sizes)
    assert sorted(np.concatenate(of_groups).tolist()) == list(range(sum(sizes) + histories.count))
    for i, of_run in enumerate(widths):
        here = histories.of_run(sum(sizes), i)
        assert [int(np.isin(at, here).sum()) for at in of_groups] == of_run


def test_a_set_less_one_effect_begins_with_what_went_on_of_the_others():
    likelihood = elsewhere()
    fit = likelihood.fit([*LEAKS, (CREEP, {p.name: p.typical for p in CREEP.parameters})])
    for i, (kept, _) in enumerate(reversed(fit.entries)):
        begun = fit.begun_without(i)
        assert [one for one, _ in begun.entries] == [kept]
        again = likelihood.terms(begun.entries, stood=begun.stood).moments.moving
        assert again.shape == begun.moving.shape
        of = np.array(fit.terms.of_effects[-1])
        assert np.array_equal(begun.moving, fit.terms.moments.moving[:, of == 1 - i])


def test_what_the_new_effect_had_done_before_is_not_known():
    begun = Begun(LEAKS, moving=np.ones((3, 1)), moving_found=True)
    with_gain, with_creep = (begun.and_one((one, {})) for one in (GAIN, CREEP))
    assert with_gain.moving is begun.moving
    assert with_gain.moving_found
    assert with_creep.moving is None
    assert not with_creep.moving_found


def test_a_start_that_runs_to_an_end_of_its_range_leaves_the_other():
    """The better start of two went to an end, and the set was lost."""
    gains = (0.01, GAIN.sizes[0].high)
    parent = SimpleNamespace(begun=Begun(()))
    starts = [SimpleNamespace(entry=(GAIN, {GAIN.sizes[0].name: gain}), is_over=True) for gain in gains]

    class Table:
        def fitted_terms(self, start, steps, rounds):
            moments = SimpleNamespace(moving=np.zeros((1, 0)))
            gain = start.entries[0][1][GAIN.sizes[0].name]
            return SimpleNamespace(entries=start.entries, moments=moments), 0.1, gain

        def fit(self, start, least_gain):
            return SimpleNamespace(entries=start.entries)

    found = contest._grown(Table(), parent, starts)
    assert found.entries == (starts[0].entry,)
    assert contest._grown(Table(), parent, starts[1:]) is None
