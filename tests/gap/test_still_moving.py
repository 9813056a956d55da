"""What effects had done before a record goes on in it or is over: one sum over both, whatever the record shows."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import logsumexp
from scipy.stats import multivariate_normal
from test_posterior_simulated import LOOPS, MODE, run_of, sized

from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior import Likelihood, likelihood_of
from phaselead.gap.posterior.still_moving import likeliest_moving, log_sum_over_records
from phaselead.gap.residual import modelled_run
from phaselead.model import Chain

ROWS = 40


@st.composite
def records(draw):
    """Columns (n, b) in prior deviations, the effect of each, and a record (n,) of noise 1 in which some still move."""
    of_effects = sorted(draw(st.lists(st.integers(0, 2), min_size=1, max_size=5)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    columns = rng.normal(size=(ROWS, len(of_effects))) * 10 ** rng.uniform(-2, 2, size=len(of_effects))
    amounts = rng.normal(size=len(of_effects)) * np.isin(of_effects, draw(st.sets(st.integers(0, 2))))
    return columns, of_effects, columns @ amounts + rng.normal(size=ROWS)


def log_density(columns, of_effects, record, moving):
    """Of the record, the amounts of the moving effects integrated out, straight from the definition."""
    kept = columns[:, np.isin(of_effects, list(moving))]
    return multivariate_normal.logpdf(record, cov=np.eye(ROWS) + kept @ kept.T)


@given(records())
def test_what_goes_on_in_a_record_is_the_likeliest_of_all_choices(record):
    columns, of_effects, x = record
    logs = {}
    for on in product((False, True), repeat=3):
        moving = frozenset(e for e in range(3) if on[e] and e in of_effects)
        logs[moving] = log_density(columns, of_effects, x, moving)
    kept, ratios = likeliest_moving(columns.T @ columns, columns.T @ x, of_effects)
    chosen = frozenset(np.array(of_effects)[kept].tolist())
    assert logs[chosen] == pytest.approx(max(logs.values()), abs=1e-6)
    assert set(ratios) == set(of_effects)
    for effect, ratio in ratios.items():
        assert ratio == pytest.approx(logs[chosen | {effect}] - logs[chosen - {effect}], abs=1e-5)


@given(st.lists(st.floats(-40, 40), max_size=7))
def test_every_number_of_records_is_as_likely(ratios):
    n, logs = len(ratios), []
    for on in product((0, 1), repeat=n):
        logs.append(float(np.dot(on, ratios)) - np.log((n + 1) * comb(n, sum(on))))
    likeliest = sum(max(ratio, 0.0) for ratio in ratios)
    assert log_sum_over_records(ratios) == pytest.approx(logsumexp(logs) - likeliest, abs=1e-9)


@pytest.mark.parametrize("n", [1, 10, 40])
def test_records_that_find_nothing_cost_what_their_number_says(n):
    """Not what each could have found, and nothing where none can tell."""
    assert log_sum_over_records([-30.0] * n) == pytest.approx(-np.log(n + 1))
    assert log_sum_over_records([0.0] * n) == pytest.approx(0.0, abs=1e-9)


def ringing() -> tuple[Likelihood, tuple[SizedEffect, ...]]:
    """Records of a stage with a mode, from which nothing rings when they begin, and the mode."""
    entries, runs = sized(((MODE, {"f_Hz": 90.0, "zeta": 0.05, "c": 0.3}),)), []
    for seed, role in enumerate(("reference", "train", "train", "holdout")):
        run = run_of(role, seed)
        noise_um = 0.01 * np.random.default_rng(seed).normal(size=len(run.t_s))
        x_um = Chain(LOOPS, run.t_s, run.u_V).run(entries if role != "reference" else ()) + noise_um
        runs.append(modelled_run(LOOPS, replace(run, x_um=x_um)))
    return likelihood_of(runs), entries


def of_all_choices(likelihood: Likelihood, entries: tuple[SizedEffect, ...]) -> float:
    """Log evidence of a set with one slow effect, summed over every choice of records in which it goes on, each fitted
    anew."""
    all_moving = likelihood.terms(entries).moments.moving
    changed, logs = [i for i, run in enumerate(likelihood.runs) if run.changed], []
    for on in product((0, 1), repeat=len(changed)):
        moving = np.ones_like(all_moving)
        moving[changed] = np.array(on)[:, None]
        terms, share, _ = likelihood.fitted_terms(likelihood.terms(entries, moving))
        _, ratios = likelihood._moving(terms, share)
        of_others = sum(log_sum_over_records(list(of_runs.values())) for of_runs in ratios)
        log_choices = np.log((len(changed) + 1) * comb(len(changed), sum(on)))
        logs.append(likelihood.judged(terms, share).log_evidence - of_others - log_choices)
    return float(logsumexp(logs))


@pytest.mark.parametrize("moved", [(), (1,), (1, 2, 3)])
@pytest.mark.parametrize("amount", [0.03, 0.1])
def test_the_evidence_of_a_slow_effect_is_the_sum_over_all_choices_of_records(moved, amount):
    """Fitted anew each: the parameters belong to what goes on beside them. As they were found beside everything they
    cost up to 6 log units here."""
    likelihood, entries = ringing()
    runs = []
    for i, run in enumerate(likelihood.runs):
        before = run.simulated(entries).before
        runs.append(Shifted(run, amount * before.sum(axis=1) if i in moved else 0.0))
    shifted = replace(likelihood, runs=tuple(runs))
    # Every fit ends within LEAST_GAIN of the best, and the one of the likeliest choice stands for all near it.
    assert shifted.fit(entries).log_evidence == pytest.approx(of_all_choices(shifted, entries), abs=0.35)


class Shifted:
    """A run to whose coefficients (n - 1,) something is added."""

    def __init__(self, run, added):
        self._run, self._added = run, added

    def __getattr__(self, name):
        return getattr(self._run, name)

    @property
    def base_error(self):
        return self._run.base_error + np.reshape(self._added, (-1, 1))

    def error(self, entries, stood):
        return self._run.error(entries, stood) + np.reshape(self._added, (-1, 1))

    def simulated(self, entries, stood=None):
        found = self._run.simulated(entries, stood)
        columns = found.columns.copy()
        columns[:, -1] += self._added
        return replace(found, columns=columns)
