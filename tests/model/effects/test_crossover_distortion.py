"""The dead zone of an output stage inside the amplifier's loop."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import LINEAR, axis
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.model.chain import simulate
from phaselead.model.effects import effect
from phaselead.model.effects.between_rows import band_limited, derivative_at_rows

laws = settings(max_examples=25, deadline=None)
STEP_s = 1 / 6400
LINE = axis(LINEAR)


def multisine(level_V: float, rows: int = 4096, highest: float = 0.8, seed: int = 1) -> np.ndarray:
    """Two periods (2 rows,) of random phases up to a share of half the rate, of an rms of ``level_V``."""
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, int(highest * rows / 2))
    u = np.fft.irfft(np.concatenate([[0], np.exp(1j * phases)]), rows)
    return np.tile(level_V * u / u.std(), 2)


def lost(u: np.ndarray, width_V: float, tau_s: float) -> np.ndarray:
    """What the dead zone takes of the voltages (n,), by the step of a record."""
    t = np.arange(len(u)) * STEP_s
    given = [(effect("crossover_distortion"), {"width_V": width_V, "tau_s": tau_s})]
    return (simulate(LINE, t, u) - simulate(LINE, t, u, extra=given)) / 10


@laws
@given(st.integers(0, 99), st.floats(0.1, 0.45))
def test_between_its_rows_a_band_limited_signal_is_known(seed, f):
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi)
    rows, fine = np.arange(3000), np.arange(12000) / 4
    x, between = (np.sin(2 * np.pi * f * at + phase) for at in (rows, fine))
    assert np.allclose(band_limited(x, 4)[4000:8000], between[4000:8000], atol=3e-3)
    rate = 2 * np.pi * f * np.cos(2 * np.pi * f * rows + phase)
    assert np.allclose(derivative_at_rows(between, 4, 1.0)[1000:2000], rate[1000:2000], atol=1e-2)


@laws
@given(width_V=st.floats(0.001, 0.3), tau_s=st.floats(2e-5, 1e-3), scale=st.floats(0.1, 10.0))
def test_drive_and_dead_zone_scale_together(width_V, tau_s, scale):
    u = multisine(0.3, 512)
    assert np.allclose(lost(scale * u, scale * width_V, tau_s), scale * lost(u, width_V, tau_s), rtol=1e-6, atol=1e-9)


@laws
@given(width_V=st.floats(0.005, 0.05), tau_s=st.floats(5e-5, 2e-4))
def test_weak_drives_lose_the_larger_share(width_V, tau_s):
    """It has a size in volts: three times the drive loses less than three times as much."""
    weak, strong = (np.std(lost(multisine(level), width_V, tau_s)[4096:]) / level for level in (0.3, 0.9))
    assert strong < weak < 3.5 * strong


@pytest.mark.parametrize("f_Hz", [50.0, 100.0, 200.0])
def test_slow_reversals_are_left_to_the_loop(f_Hz):
    """A dead band by itself takes as much of a slow sine as of a fast one."""
    t = np.arange(6400) * STEP_s
    slow, fast = (np.std(lost(np.sin(2 * np.pi * f * t), 0.02, 1e-4)[3200:]) for f in (f_Hz, 4 * f_Hz))
    assert 1.5 * slow < fast
    assert slow < 0.2 * 0.02


@laws
@given(held=st.floats(-5.0, 5.0), width_V=st.floats(0.001, 0.5), tau_s=st.floats(1e-5, 1e-3))
def test_at_rest_the_loop_has_made_up_for_it(held, width_V, tau_s):
    u = np.concatenate([np.zeros(1000), np.linspace(0, held, 400), np.full(4000, held)])
    assert np.abs(lost(u, width_V, tau_s)[3000:5000]).max() < 0.02 * width_V


@laws
@given(width_V=st.floats(0.005, 0.05), tau_s=st.floats(5e-5, 2e-4))
def test_twice_the_rate_sees_the_same(width_V, tau_s):
    """Up to what a record of the lower rate cannot hold."""
    u = multisine(0.3, highest=0.5)
    spectrum = np.fft.rfft(u)
    fine = 2 * np.fft.irfft(np.concatenate([spectrum, np.zeros(len(u) // 2)]), 2 * len(u))
    t = np.arange(len(fine)) * STEP_s / 2
    given = [(effect("crossover_distortion"), {"width_V": width_V, "tau_s": tau_s})]
    there = (simulate(LINE, t, fine) - simulate(LINE, t, fine, extra=given)) / 10
    low = [np.fft.rfft(x[len(x) // 2 :])[1:1500] / len(x) for x in (lost(u, width_V, tau_s), there)]
    assert np.linalg.norm(low[0] - low[1]) < 0.15 * np.linalg.norm(low[1])
