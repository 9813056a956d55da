"""Laws of predicted separations and of bounds, on a straight line with noise and a misfit of its own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from phaselead.gap.bounds import upper_bounds
from phaselead.gap.metric import metric_of
from phaselead.gap.posterior import Contest, Forecast, search_sets
from phaselead.gap.posterior.build import space_of
from phaselead.gap.posterior.evidence import Solver
from phaselead.gap.posterior.space import Space
from phaselead.gap.problem import Problem, make_problem
from phaselead.gap.records import GapRun
from phaselead.gap.refit import Fitted
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
SLOW, FAST = (1.0, 2.3), (11.0, 37.0)


def wave(lines_Hz: tuple[float, ...]) -> np.ndarray:
    t = np.arange(ROWS) * STEP_s
    return 4 + sum(1.5 * np.sin(2 * np.pi * f * t) for f in lines_Hz)


def run_of(u: np.ndarray, role: str, seed: int, *entries) -> GapRun:
    """A run of the line with effects. What it misses beside them: a little of the squared voltage."""
    t = np.arange(len(u)) * STEP_s
    x = Chain(LINE, t, u).run(entries) + 0.05 * (u - 4) ** 2 / 16
    x = x + NOISE_um * np.random.default_rng(seed).normal(size=len(u))
    return GapRun("x", role, t, u, x, None, 0, len(u), f"{seed}.csv", str(seed), {}, {})  # type: ignore[arg-type]


@cache
def learned(lag_s: float) -> tuple[Problem, Solver]:
    """After a sensor's lag: trained on slow sines, with slow and fast reference records."""
    hidden = (effect("sensor_lowpass"), {"tau_s": lag_s})
    runs = [run_of(wave(lines), "reference", 10 + i) for i, lines in enumerate((SLOW, FAST))]
    runs += [run_of(wave(SLOW), "train", 20, hidden), run_of(wave((1.7,)), "holdout", 30, hidden)]
    problem = make_problem(LINE, runs, RIVALS, frozen=True)
    return problem, search_sets(problem, RIVALS, lambda share: None).solver


def separation(
    lag_s: float,
    lines: tuple[float, ...],
    shared: float = 1.0,
    own: float = 1.0,
    left_out: int | None = None,
    rival: float = 1.0,
) -> float:
    """Between a sensor's lag and a delay ``rival`` times as long, by one more record of these lines, where the base
    misses ``shared`` times as much in all records and ``own`` times as much in each, and without the record
    ``left_out``."""
    problem, solver = learned(lag_s)
    space = solver.space
    records = tuple(record for i, record in enumerate(space.records) if i != left_out)
    space = Space(records, shared * space.shared, own * space.own, space.made_by)
    scaled = Solver(space, {e.name: e for e in RIVALS}, solver.alone)
    sets = [((effect("sensor_lowpass"), {"tau_s": lag_s}),), ((effect("delay"), {"delay_s": rival * lag_s}),)]
    proposed = modelled_run(LINE, replace(run_of(wave(lines), "train", 0), x_um=np.zeros(ROWS)))
    metric = metric_of([proposed], problem.noise)
    forecast = Forecast(scaled, problem, sets)
    return float(forecast.squared_distances(proposed, lambda columns: metric.project(0, columns))[0, 1])


def test_a_larger_effect_is_easier_to_tell():
    apart = [separation(size, FAST) for size in (1e-3, 2e-3, 4e-3)]
    assert apart[0] < apart[1] < apart[2]


@pytest.mark.parametrize("lines", [FAST, (5.0, 60.0)])
def test_a_base_that_misses_more_makes_it_harder(lines):
    apart = [separation(3e-3, lines, misfit, misfit) for misfit in (1.0, 10.0, 100.0)]
    assert apart[0] > 1.5 * apart[1] > 2 * apart[2] > 0


def test_a_waveform_that_a_reference_record_played_wins_where_the_misfit_of_the_base_dominates():
    """The fast reference record is the last one. It says little where the base misses nothing."""
    for misfit, least, most in ((0.01, 0.9, 1.5), (100.0, 1.5, np.inf)):
        gained = separation(3e-3, FAST, misfit) / separation(3e-3, FAST, misfit, left_out=3)
        assert least < gained < most


def test_it_does_not_matter_where_the_parameters_of_a_rival_stood():
    """They move as far as the records that are there allow."""
    assert separation(3e-3, FAST, rival=1.2) == pytest.approx(separation(3e-3, FAST), rel=0.2)


@pytest.mark.parametrize(("hidden", "params"), [("gain_change", {"gain": 2e-4}), ("sensor_lowpass", {"tau_s": 4e-5})])
def test_a_bound_holds_the_size_of_what_is_too_small_to_be_named(hidden, params):
    """Nineteen times out of twenty."""
    (size,), bounds = params.values(), []
    for seed in range(TRIALS):
        entry = (effect(hidden), params)
        runs = [run_of(wave(lines), "reference", 1000 * seed + i) for i, lines in enumerate((SLOW, FAST))]
        runs += [run_of(wave(FAST), "train", 1000 * seed + 5, entry)]
        runs += [run_of(wave(SLOW), "holdout", 1000 * seed + 6, entry)]
        problem = make_problem(LINE, runs, RIVALS, frozen=True)
        contest = Contest(Solver(space_of(problem), {}, {}), {}, {}, len(RIVALS))
        found, _ = upper_bounds(
            Selection(problem, LINE, Fitted((), 0.0), contest=contest), [effect(hidden)], set(), "x"
        )
        bounds += [bound.upper_95 for bound in found]
    assert sum(upper >= size for upper in bounds) >= FEWEST_HELD
    assert np.median(bounds) < 20 * size
