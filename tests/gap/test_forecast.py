"""Laws of predicted separations and of bounds, on a straight line with noise and a misfit of its own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from phaselead.gap.bounds import upper_bounds
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior import Contest, Forecast, Likelihood, likelihood_of
from phaselead.gap.posterior.starts import Starts
from phaselead.gap.records import GapRun
from phaselead.gap.residual import modelled_run
from phaselead.gap.selection import Selection
from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.chain import Chain
from phaselead.model.effects import effect

STEP_s, ROWS, NOISE_um = 1e-3, 1500, 0.05
LINE = AxisModel(time=TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s))
RIVALS = [effect("delay"), effect("sensor_lowpass"), effect("gain_change")]
TRIALS, FEWEST_HELD = 40, 35
"""Of 40 bounds at 95 % fewer than 35 hold once in sixty times (binomial)."""
SLOW, FAST, VERY_FAST = (1.0, 2.3), (11.0, 37.0), (40.0, 170.0)
LAG_s = 4e-4
"""Which the slow records do not tell from a delay."""


def wave(lines_Hz: tuple[float, ...]) -> np.ndarray:
    t = np.arange(ROWS) * STEP_s
    return 4 + sum(1.5 * np.sin(2 * np.pi * f * t) for f in lines_Hz)


def run_of(u: np.ndarray, role: str, seed: int, *entries) -> GapRun:
    """A run of the line with effects. What it misses beside them: a little of the squared voltage."""
    t = np.arange(len(u)) * STEP_s
    x = Chain(LINE, t, u).run(entries) + 0.05 * (u - 4) ** 2 / 16
    x = x + NOISE_um * np.random.default_rng(seed).normal(size=len(u))
    return GapRun("x", role, t, u, x, None, 0, len(u), f"{seed}.csv", {}, {})  # type: ignore[arg-type]


@cache
def learned(lag_s: float) -> Likelihood:
    """After a sensor's lag: trained on slow sines, with slow and fast reference records."""
    hidden = (effect("sensor_lowpass"), {"tau_s": lag_s})
    runs = [run_of(wave(lines), "reference", 10 + i) for i, lines in enumerate((SLOW, FAST))]
    runs += [run_of(wave(SLOW), "train", 20, hidden), run_of(wave((1.7,)), "holdout", 30, hidden)]
    return likelihood_of([modelled_run(LINE, run) for run in runs])


def separation(
    lag_s: float, lines: tuple[float, ...], missed: float = 1.0, rival: float = 1.0, free: bool = True
) -> float:
    """Between a sensor's lag, which is true, and a delay ``rival`` times as long, by one more record of these lines,
    where the base misses ``missed`` times as much. ``free``: whether the delay may move."""
    likelihood = learned(lag_s)
    expected = replace(likelihood.expected, share=missed**2 * likelihood.expected.share)
    sets = [((effect("sensor_lowpass"), {"tau_s": lag_s}),), ((effect("delay"), {"delay_s": rival * lag_s}),)]
    proposed = modelled_run(LINE, replace(run_of(wave(lines), "train", 0), x_um=np.zeros(ROWS)))
    forecast = Forecast(replace(likelihood, expected=expected), sets)
    return float(forecast.squared_distances(proposed, free)[1, 0])


def test_a_larger_effect_is_easier_to_tell():
    apart = [separation(size, FAST) for size in (2e-4, 4e-4, 8e-4)]
    assert apart[0] < apart[1] < apart[2]


@pytest.mark.parametrize("lines", [FAST, (5.0, 60.0)])
def test_a_base_that_misses_more_makes_it_harder(lines):
    apart = [separation(LAG_s, lines, missed) for missed in (1.0, 10.0, 100.0)]
    assert apart[0] > 1.5 * apart[1] > 2 * apart[2] > 0


@pytest.mark.parametrize("lines", [FAST, VERY_FAST])
@pytest.mark.parametrize("rival", [0.8, 1.2])
def test_it_does_not_matter_where_the_parameters_of_a_rival_stood(rival, lines):
    """They move as far as the records that are there allow."""
    beside = separation(LAG_s, lines)
    assert separation(LAG_s, lines, rival=rival) == pytest.approx(beside, rel=0.2)
    assert separation(LAG_s, lines, rival=rival, free=False) > 2 * beside


def lag_or_delay() -> list[tuple[SizedEffect]]:
    return [((effect("sensor_lowpass"), {"tau_s": LAG_s}),), ((effect("delay"), {"delay_s": LAG_s}),)]


def test_what_the_base_may_lack_in_all_records_makes_it_harder():
    """Here what a lag and a delay differ by, which slow records do not show. A fast reference record says that it is
    not lacking."""
    proposed = modelled_run(LINE, replace(run_of(wave(FAST), "train", 0), x_um=np.zeros(ROWS)))
    sets = lag_or_delay()

    def between(run):
        return run.coefficients((run.modelled.answer(sets[0]) - run.modelled.answer(sets[1]))[:, None])

    with_fast = learned(LAG_s)
    slow_alone = likelihood_of([run.modelled for i, run in enumerate(with_fast.runs) if i != 1])
    for likelihood, least, most in ((with_fast, 0.7, 1.0), (slow_alone, 0.0, 0.5)):
        apart = [
            Forecast(of, sets).squared_distances(proposed)[1, 0] for of in (likelihood, likelihood.missing(between))
        ]
        assert least * apart[0] <= apart[1] <= most * apart[0]


def test_what_a_set_says_that_the_base_lacks_goes_on_in_the_next_record():
    """Without the lag in it a set has found it to be lacking, so that it predicts what a set with the lag does."""
    proposed = modelled_run(LINE, replace(run_of(wave(FAST), "train", 0), x_um=np.zeros(ROWS)))
    lag, _ = lag_or_delay()

    def late(run):
        moved = run.modelled.answer(lag) - run.modelled.answer(())
        return run.coefficients(moved[:, None]) * (run.modelled.run.role != "reference")

    likelihood = learned(LAG_s)
    plain, lacking = (
        Forecast(of, [lag, ()]).squared_distances(proposed) for of in (likelihood, likelihood.missing(late))
    )
    assert lacking[1, 0] < 0.05 * plain[1, 0]
    assert lacking[0, 1] < 0.05 * plain[0, 1]


def test_what_may_be_missed_in_all_records_is_known_of_any_other():
    lag, delay = (one for (one,) in lag_or_delay())
    likelihood = learned(LAG_s).knowing([lag, delay]).with_misfit_of([lag])
    assert likelihood.among_shared.size > 3
    for run, columns in zip(likelihood.runs, likelihood.shared, strict=True):
        found = likelihood.shared_in(run)
        assert found[run.first_octave :] == pytest.approx(columns[run.first_octave :], abs=1e-12)


def test_a_set_is_at_no_distance_from_itself():
    lag = ((effect("sensor_lowpass"), {"tau_s": LAG_s}),)
    proposed = modelled_run(LINE, replace(run_of(wave(FAST), "train", 0), x_um=np.zeros(ROWS)))
    for free in (True, False):
        found = Forecast(learned(LAG_s), [lag, lag, ()]).squared_distances(proposed, free)
        assert np.diag(found) == pytest.approx(0.0)
        assert [found[0, 1], found[1, 0]] == pytest.approx([0.0, 0.0], abs=1e-9)
        assert min(found[2, 0], found[0, 2]) > 1


@pytest.mark.parametrize(("hidden", "params"), [("gain_change", {"gain": 2e-4}), ("sensor_lowpass", {"tau_s": 4e-5})])
def test_a_bound_holds_the_size_of_what_is_too_small_to_be_named(hidden, params):
    """Nineteen times out of twenty."""
    (size,), bounds = params.values(), []
    for seed in range(TRIALS):
        entry = (effect(hidden), params)
        runs = [run_of(wave(lines), "reference", 1000 * seed + i) for i, lines in enumerate((SLOW, FAST))]
        runs += [run_of(wave(FAST), "train", 1000 * seed + 5, entry)]
        runs += [run_of(wave(SLOW), "holdout", 1000 * seed + 6, entry)]
        likelihood = likelihood_of([modelled_run(LINE, run) for run in runs])
        contest = Contest(likelihood, {}, Starts(likelihood, [effect(hidden)]))
        found, _ = upper_bounds(Selection(None, LINE, (), contest=contest), [effect(hidden)], set())
        bounds += [bound.upper_95 for bound in found]
    assert sum(upper >= size for upper in bounds) >= FEWEST_HELD
    assert np.median(bounds) < 20 * size


def test_noise_that_rest_shows_is_averaged_over_a_longer_record():
    """A small lag is told from a small delay the better, the more rows there are; where no record at rest tells the
    noise, what looks like it may be missed in all of them."""
    lag_s = 1e-5
    sets = [((effect("sensor_lowpass"), {"tau_s": lag_s}),), ((effect("delay"), {"delay_s": 3 * lag_s}),)]
    without_rest = learned(lag_s)
    still = modelled_run(LINE, run_of(np.full(4 * ROWS, 4.0), "reference", 5))
    with_rest = likelihood_of([still, *(run.modelled for run in without_rest.runs)])
    gained = []
    for likelihood in (without_rest, with_rest):
        found = []
        for count in (1, 8):
            u = np.tile(wave(FAST), count)
            proposed = modelled_run(LINE, replace(run_of(u, "train", 0), x_um=np.zeros(len(u))))
            found.append(Forecast(likelihood, sets).squared_distances(proposed, free=False)[1, 0])
        gained.append(found[1] / found[0])
    assert gained[0] < 1.15
    assert 1.3 < gained[1] < 8
