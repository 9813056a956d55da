"""Laws of the noise of a residual: a draw of it is as likely as it says, and the most likely one is found again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from phaselead.gap.noise import Noise, as_idle, fit_noise

STEP_s = 1e-3


def wave(n: int) -> np.ndarray:
    t = np.arange(n) * STEP_s
    return 4 + 2 * np.sin(2 * np.pi * 1.3 * t) + 1.5 * np.sin(2 * np.pi * 0.37 * t)


@pytest.mark.parametrize("wander", [0.0, 1e-3])
@pytest.mark.parametrize("taps", [[1.0], [1.0, -0.6], [1.0, -0.3, 0.1]])
def test_a_residual_is_as_unlikely_as_its_covariance_says(wander, taps):
    """The misfit's steps, filtered as the sensor's noise is, are normal of a covariance with three diagonals."""
    rng, n, order = np.random.default_rng(0), 60, len(taps)
    u, e = rng.uniform(0, 8, n), rng.normal(size=n)
    differences = []
    for sigma, misfit, length in ((0.1, 0.3, 2.0), (0.2, 0.1, 0.5), (0.05, 0.05, 20.0)):
        noise = Noise(np.array(taps), sigma, misfit, length, wander)
        phi = np.exp(-np.abs(np.diff(u)) / length)
        white = np.convolve(e, np.array(taps) / sigma)[:n]
        steps = (white[1:] - phi * white[:-1])[order:]
        grown = (misfit**2 * (1 - phi**2) + wander * STEP_s) * (sum(taps) / sigma) ** 2
        p = phi[order:]
        covariance = np.diag(grown[order:] + 1 + p**2) - np.diag(p[1:], 1) - np.diag(p[1:], -1)
        density = multivariate_normal(np.zeros(len(steps)), covariance).logpdf(steps) - len(steps) * np.log(sigma)
        differences.append(noise.minus_log_likelihood(e, u, STEP_s) + density)
    assert np.ptp(differences) < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_the_noise_of_which_residuals_were_drawn_is_found(seed):
    rng = np.random.default_rng(seed)
    truth = Noise(np.ones(1), 0.01, 0.1, 2.0)
    u = wave(6000)
    driven, idle = truth.drawn(u, STEP_s, rng), truth.drawn(np.zeros(6000), STEP_s, rng)
    found = fit_noise([(driven, u)], [idle - idle.mean()], STEP_s)
    assert found.sigma_um == pytest.approx(0.01, rel=0.1)
    # Over ways much shorter than the length only misfit^2 / length shows.
    assert found.misfit_um**2 / found.length_V == pytest.approx(0.1**2 / 2.0, rel=0.5)


def test_a_sensor_that_filters_its_noise_is_found_at_rest():
    truth = Noise(np.array([1.0, -0.6]), 0.01)
    idle = truth.drawn(np.zeros(6000), STEP_s, np.random.default_rng(6))
    found = fit_noise([], [idle], STEP_s)
    assert found.sigma_um == pytest.approx(0.01, rel=0.05)
    assert found.sensor[1] == pytest.approx(-0.6, abs=0.05)


def test_without_a_record_at_rest_the_roughness_is_the_sensors():
    rng = np.random.default_rng(4)
    u = wave(6000)
    found = fit_noise([(Noise(np.ones(1), 0.01, 0.1, 2.0).drawn(u, STEP_s, rng), u)], [], STEP_s)
    assert found.sigma_um == pytest.approx(0.01, rel=0.3)


def test_draws_are_as_large_as_the_noise_says():
    rng = np.random.default_rng(5)
    u = 4 - 4 * np.cos(2 * np.pi * 5 * STEP_s * np.arange(20000))
    still, moving = (Noise(np.ones(1), 0.02, misfit, 0.5).drawn(u, STEP_s, rng) for misfit in (0.0, 0.1))
    assert still.std() == pytest.approx(0.02, rel=0.05)
    assert moving.std() == pytest.approx(np.hypot(0.02, 0.1), rel=0.2)


def test_records_at_rest_bring_their_own_noise():
    rng = np.random.default_rng(1)
    quiet = Noise(np.ones(1), 0.01)
    still = 0.01 * rng.normal(size=5000)
    assert as_idle(quiet, [still]) is quiet
    humming = still + 0.03 * np.sin(2 * np.pi * 50 * STEP_s * np.arange(5000))
    louder = as_idle(quiet, [humming])
    white = lfilter(louder.sensor / louder.sigma_um, [1.0], humming)[50:]
    assert np.mean(white**2) < 1.3
    assert np.mean((humming / quiet.sigma_um) ** 2) > 3
