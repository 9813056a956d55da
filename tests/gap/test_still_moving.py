"""What effects had done before a record goes on in it or is over: one sum over both, whatever the record shows."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from phaselead.gap.posterior.still_moving import STILL_MOVING, still_moving

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


def every_set(of_effects):
    found = [set()]
    for effect in set(of_effects):
        found += [one | {effect} for one in found]
    return found


@given(records())
def test_the_evidence_is_the_sum_over_all_that_may_still_move(record):
    columns, of_effects, x = record
    logs = {frozenset(one): log_density(columns, of_effects, x, one) for one in every_set(of_effects)}
    exact = logsumexp(list(logs.values())) + len(set(of_effects)) * np.log(0.5)
    assert STILL_MOVING == 0.5
    kept, above = still_moving(columns.T @ columns, columns.T @ x, of_effects)
    chosen = frozenset(np.array(of_effects)[kept].tolist())
    assert abs(max(logs.values()) - logs[chosen]) < 1e-6
    assert abs(logs[chosen] + above - exact) < 1e-6


@given(records())
def test_finding_nothing_costs_a_record_no_more_than_the_chance_of_nothing(record):
    columns, of_effects, _ = record
    still = np.zeros(columns.shape[1])
    kept, above = still_moving(columns.T @ columns * 1e6, still, of_effects)
    assert not kept.any()
    assert above >= len(set(of_effects)) * np.log(1 - STILL_MOVING)
    kept, above = still_moving(np.zeros((len(still), len(still))), still, of_effects)
    assert abs(above) < 1e-9  # a record that cannot tell costs nothing
