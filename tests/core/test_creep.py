"""Creep undone: the forward lags of what comes out are what went in."""

import math

import numpy as np
import pytest
from compensations import ONE_Q64, creeps
from core_bindings import Creep, CreepState, any_i64, whole
from hypothesis import given
from hypothesis import strategies as st

Q40 = 2.0**40
TERMS = ((0.004, 0.1), (0.006, 1.0), (0.008, 10.0), (0.01, 100.0))


def creep_of(terms):
    """(k, tau_s) as the device holds them."""
    alpha = [round(-math.expm1(-1 / (5000 * tau)) * 2**48) << 16 for _, tau in terms]
    return Creep(tuple(alpha), tuple(round(k * 2**30) for k, _ in terms))


def undo(core, config, um, state=None):
    values = np.round(um * Q40).astype(np.int64)
    core.h_creep_many(config, state or CreepState(), values.ctypes.data, len(values))
    return values / Q40


def with_creep(config, d_um):
    """The lags in float: their input is constant over a tick."""
    k, alpha = np.array(config.k_q30) / 2**30, np.array(config.alpha_q64) / float(ONE_Q64)
    lag, x = np.zeros(8), np.empty(len(d_um))
    for i, d in enumerate(d_um):
        x[i] = d + k @ lag
        lag += alpha * (d - lag)
    return x


@given(creeps, st.integers(0, 2**32))
def test_forward_of_inverse_is_the_identity(core, config, seed):
    um = np.cumsum(np.random.default_rng(seed).uniform(-1, 1, 300))
    assert np.abs(with_creep(config, undo(core, config, um)) - um).max() < 1e-7


def test_a_step_held_for_minutes_neither_stalls_nor_drifts(core):
    """Rounded to int32 the 100 s state would stall a third of a micrometre short; here it does not."""
    config, n = creep_of(TERMS), 900_000
    d = undo(core, config, np.full(n, 100.0))
    total = sum(k for k, _ in TERMS)
    exact = 100 / (1 + total)
    slow = TERMS[-1]
    rate = (1 + total) / (1 + total - slow[0]) / slow[1]  # of the slowest of the inverse, once the others have settled
    left = (100 / (1 + total - slow[0]) - exact) * math.exp(-rate * n / 5000)
    assert d[-1] - exact == pytest.approx(left, rel=0.05)
    assert d[0] == 100
    assert (np.diff(d) <= 0).all()


@pytest.mark.parametrize(
    ("config", "usable"),
    [
        (Creep(), True),
        (Creep(k_q30=(1 << 28, -(1 << 28))), True),
        (Creep(k_q30=(1 << 28, -(1 << 28), 1)), False),
        (Creep(k_q30=(-(2**31),)), False),
        (Creep((ONE_Q64 // 4,)), True),
        (Creep((ONE_Q64 // 4 + 1,)), False),
        (Creep((-1,)), False),
    ],
)
def test_what_is_usable(core, config, usable):
    assert core.creep_make(config) == usable


@given(creeps, st.lists(any_i64, min_size=8, max_size=8), st.lists(whole(-(2**56), 2**56), min_size=1, max_size=10))
def test_any_state_stays_bounded_once_admitted(core, config, lags, values):
    state = CreepState(tuple(lags))
    core.creep_admit(state)
    inputs = np.array(values, np.int64)
    core.h_creep_many(config, state, inputs.ctypes.data, len(inputs))
    assert np.abs(inputs).max() <= 2**56
    assert max(abs(lag) for lag in state.lag_q40) <= 2**56
