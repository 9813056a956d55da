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
from test_posterior_simulated import SETS, learned, sized

from phaselead.gap.posterior.still_moving import likeliest_moving, log_sum_over_records

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


def of_all_choices(likelihood, entries):
    """Log evidence of a set with one slow effect, summed over every choice of records in which it goes on, each fitted
    anew."""
    first = likelihood.terms(entries)
    changed = [i for i, run in enumerate(likelihood.runs) if run.changed]
    logs = []
    for on in product((0, 1), repeat=len(changed)):
        moving = np.ones_like(first.moments.moving)
        moving[changed] = np.array(on)[:, None]
        terms, _, _ = likelihood.fitted_terms(likelihood.terms(entries, moving))
        at = likelihood.judged(terms, likelihood.likeliest_share(terms)[1]).log_evidence
        _, ratios = likelihood._moving(terms, likelihood.likeliest_share(terms)[1])
        above = sum(log_sum_over_records(list(of_runs.values())) for of_runs in ratios)
        logs.append(at - above - np.log((len(changed) + 1) * comb(len(changed), sum(on))))
    return logsumexp(logs)


@pytest.mark.parametrize("moved", [(), (1,), (1, 2, 3)])
@pytest.mark.parametrize("amount", [0.03, 0.3])
def test_the_evidence_of_a_slow_effect_is_the_sum_over_all_choices_of_records(moved, amount):
    """Fitted anew each: the parameters belong to what goes on beside them."""
    entries, likelihood = sized(SETS["a slow one"]), learned()
    runs = []
    for i, run in enumerate(likelihood.runs):
        mine = run.simulated(entries)
        before = mine.before @ np.full(mine.before.shape[1], amount) if i in moved else 0.0
        runs.append(Shifted(run, before))
    shifted = replace(likelihood, runs=tuple(runs))
    assert shifted.fit(entries).log_evidence == pytest.approx(of_all_choices(shifted, entries), abs=1.0)


class Shifted:
    """A run to whose coefficients (n - 1,) something is added."""

    def __init__(self, run, added):
        self._run, self._added = run, added

    def __getattr__(self, name):
        return getattr(self._run, name)

    @property
    def base_error(self):
        return self._run.base_error + np.reshape(self._added, (-1, 1))

    def coefficients(self, columns):
        """Of a residual, the only one that the likelihood asks for."""
        return self._run.coefficients(columns) + np.reshape(self._added, (-1, 1))

    def simulated(self, entries):
        found = self._run.simulated(entries)
        columns = found.columns.copy()
        columns[:, -1] += self._added
        return replace(found, columns=columns)
