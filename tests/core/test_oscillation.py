"""A loop that runs away is found while it is small; whatever a stable one does is not."""

import numpy as np
import pytest
from core_bindings import OscillationState
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import chirp, lsim

UM, TICK_S = 1 << 16, 2e-4
LIMIT_UM = 280 / 256
"""The default: a 256th of the sensor's range."""
NOISE_UM = 0.01
"""Of the built-in stage's sensor."""
HZ = st.floats(150, 2400)
"""Where the modes of piezo stages are."""
PHASE = st.floats(0, 2 * np.pi)


def found_at(core, error_um, reference_um=None, limit_um=LIMIT_UM):
    """The first tick in which an oscillation is found, None when there is none."""
    error = np.rint(np.clip(error_um, -32767, 32767) * UM).astype(int)
    reference = np.zeros(len(error), int) if reference_um is None else np.rint(reference_um * UM).astype(int)
    state, limit = OscillationState(), round(limit_um * UM)
    for tick, (e, r) in enumerate(zip(error.tolist(), reference.tolist(), strict=True)):
        if core.oscillation_step(state, limit, e, r):
            return tick
    return None


def seconds(duration_s):
    return np.arange(round(duration_s / TICK_S)) * TICK_S


def noise(count, seed, um=NOISE_UM):
    return np.random.default_rng(seed).normal(0, um, count)


@settings(max_examples=60, deadline=None)
@given(f_Hz=st.floats(180, 2000), phase=PHASE, periods=st.floats(2.5, 8), seed=st.integers(0, 2**32))
def test_an_oscillation_that_grows_is_found_before_it_is_large(core, f_Hz, phase, periods, seed):
    """By a factor of e in so many periods."""
    tau_s = max(periods / f_Hz, 0.003)
    t = seconds(9 * tau_s)
    amplitude = 0.02 * np.exp(t / tau_s)
    at = found_at(core, amplitude * np.sin(2 * np.pi * f_Hz * t + phase) + noise(len(t), seed))
    assert at is not None
    assert LIMIT_UM < amplitude[at] < 280 / 16


@settings(max_examples=60, deadline=None)
@given(
    f_Hz=HZ,
    zeta=st.floats(0, 0.1),
    detuned=st.floats(-0.1, 0.1),
    um=st.floats(0.01, 50),
    delay_s=st.floats(0, 0.05),
    seed=st.integers(0, 2**32),
)
def test_a_resonance_that_the_path_drives_is_none(core, f_Hz, zeta, detuned, um, delay_s, seed):
    """Its amplitude grows linearly, to whatever the damping allows."""
    t, w = seconds(0.4), 2 * np.pi * f_Hz
    path = np.where(t > delay_s, um * np.sin((1 + detuned) * w * (t - delay_s)), 0)
    _, position, _ = lsim(([w * w], [1, 2 * zeta * w, w * w]), path, t)
    assert found_at(core, np.clip(path - position, -250, 250) + noise(len(t), seed), path) is None


@settings(max_examples=60, deadline=None)
@given(
    f_Hz=st.floats(30, 2000),
    zeta=st.floats(0.002, 1),
    step_um=st.floats(0.1, 250),
    delay_s=st.floats(0, 0.02),
    again_s=st.floats(0.003, 0.2),
    seed=st.integers(0, 2**32),
)
def test_steps_of_a_loop_that_rings_are_none(core, f_Hz, zeta, step_um, delay_s, again_s, seed):
    """And a staircase, or a square wave, of them."""
    t = seconds(0.5)
    stairs = np.floor(np.clip(t - delay_s, 0, None) / again_s) % 2 * step_um
    w = 2 * np.pi * f_Hz
    _, position, _ = lsim(([w * w], [1, 2 * zeta * w, w * w]), stairs, t)
    error = stairs - position + noise(len(t), seed)
    assert found_at(core, error, stairs) is None


@settings(max_examples=40, deadline=None)
@given(
    f_Hz=st.floats(100, 800),
    zeta=st.floats(0.002, 0.1),
    end_Hz=st.floats(500, 2400),
    seconds_=st.floats(0.05, 2),
    um=st.floats(0.1, 50),
)
def test_a_sweep_through_a_resonance_is_none(core, f_Hz, zeta, end_Hz, seconds_, um):
    t, w = seconds(seconds_), 2 * np.pi * f_Hz
    swept = um * chirp(t, 1, seconds_, end_Hz)
    _, error, _ = lsim(([1, 2 * zeta * w, 0], [1, 2 * zeta * w, w * w]), swept, t)
    assert found_at(core, np.clip(error, -250, 250) + noise(len(t), 1), swept) is None


@settings(max_examples=40, deadline=None)
@given(
    f_Hz=st.floats(1, 200),
    swing_um=st.floats(1, 250),
    lag_s=st.floats(1e-4, 3e-3),
    mode_Hz=st.floats(150, 900),
    seed=st.integers(0, 2**32),
)
def test_triangles_and_sines_are_none(core, f_Hz, swing_um, lag_s, mode_Hz, seed):
    t, w = seconds(0.6), 2 * np.pi * mode_Hz
    turn = t * f_Hz % 1
    for path in (swing_um * np.minimum(2 * turn, 2 - 2 * turn), swing_um / 2 * (1 - np.cos(2 * np.pi * f_Hz * t))):
        _, position, _ = lsim(([w * w], np.polymul([1, 0.04 * w, w * w], [lag_s, 1])), path, t)
        assert found_at(core, path - position + noise(len(t), seed), path) is None


@settings(max_examples=40, deadline=None)
@given(power=st.integers(1, 6), rise_s=st.floats(0.002, 0.2), um=st.floats(1, 250), seed=st.integers(0, 2**32))
def test_a_push_is_none(core, power, rise_s, um, seed):
    t = seconds(0.4)
    push = um * np.minimum(t / rise_s, 1) ** power * np.exp(-np.clip(t - rise_s, 0, None) / 0.02)
    assert found_at(core, push + noise(len(t), seed)) is None


@settings(max_examples=20, deadline=None)
@given(um=st.floats(0, 0.3), seed=st.integers(0, 2**32))
def test_noise_below_the_limit_is_none(core, um, seed):
    assert found_at(core, noise(20_000, seed, um)) is None


@given(f_Hz=st.floats(10, 2400), um=st.floats(0, 200), phase=PHASE)
@settings(max_examples=30, deadline=None)
def test_an_oscillation_that_does_not_grow_is_none_for_half_a_second(core, f_Hz, um, phase):
    t = seconds(0.5)
    assert found_at(core, um * np.sin(2 * np.pi * f_Hz * t + phase)) is None


@given(f_Hz=st.floats(150, 2400), um=st.floats(3, 200), phase=PHASE, seed=st.integers(0, 2**32))
@settings(max_examples=30, deadline=None)
def test_one_that_stays_is_found_then(core, f_Hz, um, phase, seed):
    """A limit cycle: it grew too slowly to be found before, to where the slew limit holds it."""
    t = seconds(0.7)
    swings = um * (1 + 0.1 * np.sin(2 * np.pi * 5 * t)) * np.sin(2 * np.pi * f_Hz * t + phase)
    at = found_at(core, swings + noise(len(t), seed))
    assert at is not None
    assert 0.5 <= at * TICK_S < 0.6


@given(f_Hz=st.floats(150, 2400), um=st.floats(3, 200), um_of_path=st.floats(0.1, 10), phase=PHASE)
@settings(max_examples=30, deadline=None)
def test_not_where_the_path_drives_a_mode(core, f_Hz, um, um_of_path, phase):
    t = seconds(1.0)
    path = um_of_path * np.sin(2 * np.pi * f_Hz * t)
    error = min(um, 45 * um_of_path) * np.sin(2 * np.pi * f_Hz * t + phase)
    assert found_at(core, error, path) is None


@given(f_Hz=st.floats(150, 2400), um=st.floats(0, 1), seed=st.integers(0, 2**32))
@settings(max_examples=20, deadline=None)
def test_nor_below_what_matters(core, f_Hz, um, seed):
    t = seconds(1.0)
    assert found_at(core, um * np.sin(2 * np.pi * f_Hz * t) + noise(len(t), seed)) is None


@given(f_Hz=st.floats(100, 2000), tau_s=st.floats(0.01, 0.8), um=st.floats(3, 60))
@settings(max_examples=30, deadline=None)
def test_what_rings_down_is_none(core, f_Hz, tau_s, um):
    t = seconds(2.0)
    assert found_at(core, um * np.exp(-t / tau_s) * np.sin(2 * np.pi * f_Hz * t)) is None


@pytest.mark.parametrize("limit_um", [0.5, 2, 10])
def test_the_limit_is_in_micrometres_rms(core, limit_um):
    t = seconds(0.3)
    amplitude = 1e-3 * np.exp(t / 0.02)
    at = found_at(core, amplitude * np.sin(2 * np.pi * 600 * t), limit_um=limit_um)
    assert limit_um < amplitude[at] < 6 * limit_um


def test_any_input_is_taken(core):
    state = OscillationState()
    for tick in range(5000):
        extreme = (-(2**31), 2**31 - 1, 0)[tick % 3]
        core.oscillation_step(state, 2**31 - 1 if tick % 2 else 0, extreme, -extreme - 1)
