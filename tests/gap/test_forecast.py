"""Laws of predicted separations and of bounds, on a straight line with noise and a misfit of its own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from phaselead.gap.bounds import upper_bounds
from phaselead.gap.metric import metric_of
from phaselead.gap.posterior import Contest, Forecast, search_sets
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
def contest(lag_s: float, *references: tuple[float, ...], hidden: str = "sensor_lowpass") -> tuple[Problem, Contest]:
    """After a lag (or ``gain``) was hidden; trained on slow sines."""
    entry = (effect(hidden), {"tau_s": lag_s} if hidden == "sensor_lowpass" else {"gain": lag_s})
    runs = [run_of(wave(lines), "reference", 10 + i) for i, lines in enumerate(references)]
    runs += [run_of(wave(SLOW), "train", 20, entry), run_of(wave((1.7,)), "holdout", 30, entry)]
    problem = make_problem(LINE, runs, RIVALS, frozen=True)
    return problem, search_sets(problem, RIVALS, lambda share: None)


def separation(made: tuple[Problem, Contest], lag_s: float, lines: tuple[float, ...], misfit: float = 1.0) -> float:
    """Between a sensor's lag and a delay of that size, by one more record of these lines."""
    problem, found = made
    solver = found.solver
    space = solver.space
    sets = [((effect("sensor_lowpass"), {"tau_s": lag_s}),), ((effect("delay"), {"delay_s": lag_s}),)]
    solver.space = type(space)(space.records, misfit * space.shared, misfit * space.own, space.made_by)
    try:
        made_run = modelled_run(LINE, replace(run_of(wave(lines), "train", 0), x_um=np.zeros(ROWS)))
        metric = metric_of([made_run], problem.noise)
        forecast = Forecast(solver, problem, sets)
        return float(forecast.squared_distances(made_run, lambda columns: metric.project(0, columns))[0, 1])
    finally:
        solver.space = space


def test_a_larger_effect_is_easier_to_tell():
    apart = [separation(contest(size, SLOW, FAST), size, FAST) for size in (1e-3, 2e-3, 4e-3)]
    assert apart[0] < apart[1] < apart[2]


@pytest.mark.parametrize("lines", [FAST, (5.0, 60.0)])
def test_a_base_that_misses_more_makes_it_harder(lines):
    apart = [separation(contest(3e-3, SLOW, FAST), 3e-3, lines, misfit) for misfit in (1.0, 10.0, 100.0)]
    assert apart[0] > apart[1] > apart[2] > 0


def test_a_waveform_that_a_reference_record_played_wins_where_the_misfit_of_the_base_dominates():
    """For noise alone both say as much; only what the base misses in the one is known."""
    made = contest(3e-3, SLOW, FAST)
    other = (13.0, 36.0)
    space = made[1].solver.space
    made[1].solver.space = type(space)(space.records, 300 * space.shared, 0.01 * space.own, space.made_by)
    try:
        repeated, fresh = (separation(made, 3e-3, lines) for lines in (FAST, other))
        assert repeated > 2 * fresh
    finally:
        made[1].solver.space = space
    plain = [separation(made, 3e-3, lines, 0.01) for lines in (FAST, other)]
    assert plain[0] == pytest.approx(plain[1], rel=0.5)


def test_what_the_records_have_shown_already_is_no_news():
    """The same slow sines once more: the rival has made up for the difference."""
    made = contest(3e-3, SLOW, FAST)
    assert separation(made, 3e-3, SLOW) < 0.1 * separation(made, 3e-3, FAST)


@pytest.mark.parametrize("hidden", ["gain_change", "sensor_lowpass"])
def test_a_bound_holds_the_size_of_what_is_too_small_to_be_named(hidden):
    """Nineteen times out of twenty."""
    size = {"gain_change": 2e-4, "sensor_lowpass": 4e-5}[hidden]
    params = {"gain": size} if hidden == "gain_change" else {"tau_s": size}
    held, trials = 0, 40
    for seed in range(trials):
        runs = [run_of(wave(lines), "reference", 1000 * seed + i) for i, lines in enumerate((SLOW, FAST))]
        runs += [run_of(wave(FAST), "train", 1000 * seed + 5, (effect(hidden), params))]
        runs += [run_of(wave(SLOW), "holdout", 1000 * seed + 6, (effect(hidden), params))]
        problem = make_problem(LINE, runs, RIVALS, frozen=True)
        found = search_sets(problem, RIVALS, lambda share: None)
        selection = Selection(problem, LINE, Fitted((), 0.0), contest=found)
        bounds, _ = upper_bounds(selection, [effect(hidden)], set(), None)
        held += bounds[0].upper_95 >= size
    assert held >= 0.9 * trials  # fewer than one such series in twenty by chance
    assert bounds[0].upper_95 < 100 * size
