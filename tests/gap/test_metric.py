"""Laws of the metric in which candidates are compared: it whitens, it forgets nuisances, it raises no false alarms."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from scipy.linalg import cholesky_banded
from scipy.signal import lfilter

from phaselead.gap.disturbances.jitter import find_jitter
from phaselead.gap.disturbances.search import find_disturbances
from phaselead.gap.disturbances.vibration import find_vibration, louder_at_rest
from phaselead.gap.metric import metric_of, whitened_regressors
from phaselead.gap.noise import Noise, as_idle, differences_factor, fit_noise, whitened
from phaselead.gap.records import GapRun
from phaselead.gap.regressors import Layout, SimulatedRegressors
from phaselead.gap.residual import RunResidual, modelled_run
from phaselead.gap.scan import _inverse
from phaselead.model.axis import AxisModel, TimeView

STEP_s = 1e-3


def run_of(u_V: np.ndarray, x_um: np.ndarray, role: str = "train") -> GapRun:
    t = np.arange(len(u_V)) * STEP_s
    digest = hashlib.sha256(x_um.tobytes()).hexdigest()
    return GapRun("x", role, t, u_V, x_um, None, 0, len(u_V), "made.csv", digest, {}, {})  # type: ignore[arg-type]


def wave(n: int) -> np.ndarray:
    t = np.arange(n) * STEP_s
    return 4 + 2 * np.sin(2 * np.pi * 1.3 * t) + 1.5 * np.sin(2 * np.pi * 0.37 * t)


def misfit(rng: np.random.Generator, u_V: np.ndarray, std_um: float, length_V: float) -> np.ndarray:
    """A walk with a restoring force along the path of the voltage."""
    phi = np.exp(-np.abs(np.diff(u_V, prepend=u_V[0])) / length_V)
    m = np.zeros(len(u_V))
    for k in range(1, len(m)):
        m[k] = phi[k] * m[k - 1] + std_um * np.sqrt(1 - phi[k] ** 2) * rng.normal()
    return m


@pytest.mark.parametrize(("n", "columns", "taps"), [(60, 3, 2), (5000, 1, 16), (2500, 3, 5), (40, 2500, 4)])
def test_the_kernel_says_what_its_equations_say(n, columns, taps):
    """Also across the borders of the blocks in which it goes through rows and columns."""
    rng = np.random.default_rng(0)
    sensor, rest = np.array([2.0, -0.5, 0.25]), np.array([1.0, *rng.uniform(-0.3, 0.3, taps - 1)])
    phi, moving = rng.uniform(0.5, 1, n), rng.random(n) > 0.4
    factor = np.stack([rng.uniform(1, 2, n), rng.uniform(-0.5, 0.5, n)])
    x = rng.normal(size=(n, columns))
    sensed = lfilter(sensor, [1.0], x, axis=0)
    sensed[:2] = 0.0
    expected = np.zeros_like(x)
    for k in range(n):
        before = (phi[k] * sensed[k - 1] + factor[1, k - 1] * expected[k - 1]) if k else 0.0
        expected[k] = (sensed[k] - before) / factor[0, k]
    filtered = np.where(moving[:, None], lfilter(rest, [1.0], expected, axis=0), expected)
    np.testing.assert_allclose(whitened(x, sensor, phi, factor, rest, moving), filtered, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("rounding", [0.0, 1e-15, -1e-15])
def test_columns_that_are_one_share_what_they_explain(rounding):
    normal = np.array([[4.0, 4.0], [4.0, 4.0 + rounding]])
    amounts = _inverse(normal) @ np.array([2.0, 2.0])
    assert amounts.sum() == pytest.approx(0.5, rel=1e-3)
    assert np.abs(amounts).max() < 10 or rounding > 0


@pytest.mark.parametrize("n", [1, 2, 50])
def test_the_factor_is_that_of_the_covariance(n):
    rng = np.random.default_rng(n)
    phi, grown = rng.uniform(0, 1, n), rng.uniform(0, 3, n)
    banded = np.stack([1 + phi**2 + grown, np.append(-phi[1:], 0.0)])
    banded[0, 0] = 1 + 0.7
    np.testing.assert_allclose(differences_factor(phi, grown, 0.7)[0], cholesky_banded(banded, lower=True)[0])
    np.testing.assert_allclose(
        differences_factor(phi, grown, 0.7)[1, :-1], cholesky_banded(banded, lower=True)[1, :-1], atol=1e-15
    )


@pytest.mark.parametrize("seed", range(3))
def test_fitted_noise_is_whitened(seed):
    rng = np.random.default_rng(seed)
    u, n = wave(6000), 6000
    driven = misfit(rng, u, 0.1, 2.0) + lfilter([0.01], [1, -0.6], rng.normal(size=n))
    idle = lfilter([0.01], [1, -0.6], rng.normal(size=n))
    noise = fit_noise([(driven, u)], [idle], STEP_s)
    for e, voltage in ((driven, u), (idle, np.zeros(n))):
        white = noise.whitener(voltage, STEP_s)(e)[100:]
        assert 0.7 < np.mean(white**2) < 1.4
        assert all(abs(np.mean(white[lag:] * white[:-lag]) / np.mean(white**2)) < 0.1 for lag in (1, 2, 5, 20))


def test_records_at_rest_bring_their_own_noise():
    rng = np.random.default_rng(1)
    quiet = Noise(np.ones(1), 0.01, 0.0, 1.0, 0.0, np.ones(1))
    still = 0.01 * rng.normal(size=5000)
    assert as_idle(quiet, [still]) is quiet
    humming = still + 0.03 * np.sin(2 * np.pi * 50 * STEP_s * np.arange(5000))
    white = as_idle(quiet, [humming]).whitener(np.zeros(5000), STEP_s)(humming)
    assert np.mean(white[50:] ** 2) < 1.3
    assert np.mean(quiet.whitener(np.zeros(5000), STEP_s)(humming) ** 2) > 3


def test_a_records_own_nuisances_count_for_nothing():
    view = TimeView(
        gain_um_per_V=8.0, offset_um=0.0, delay_s=0.0, play_r_V=(0.5, 2.0), play_w_um_per_V=(1.0, 1.5),
        deadzone_d_V=(), deadzone_s_um_per_V=(), rest_fraction=0.0, rate_Hz=1 / STEP_s, u_range_V=(0.0, 8.0),
        residual_um_rms=0.01,
    )  # fmt: skip
    u = wave(4000)
    made = modelled_run(AxisModel(time=view), run_of(u, 8 * u))
    noise = Noise(np.ones(1), 1e-4, 1e-4, 1.0, 0.0, np.ones(1))
    metric = metric_of([made], noise)
    offset = np.ones((4000, 1))
    rest = metric.whiteners[0](offset)
    assert np.sum(metric.project(0, offset) ** 2) < 1e-3 * np.sum(rest**2)
    signal = np.sin(2 * np.pi * 7 * made.run.t_s)[:, None]
    with_offset = metric.project(0, signal + 3 * offset)
    np.testing.assert_allclose(with_offset, metric.project(0, signal), atol=1e-3 * np.abs(with_offset).max())


def ringing(rng: np.random.Generator, n: int, f_Hz: float, zeta: float) -> np.ndarray:
    """White noise through a mode, as surroundings keep one ringing."""
    r, turn = np.exp(-2 * np.pi * f_Hz * zeta * STEP_s), 2 * np.pi * f_Hz * STEP_s
    x = lfilter([1.0], [1, -2 * r * np.cos(turn), r * r], rng.normal(size=n + 2000))[2000:]
    return np.asarray(0.01 * x / x.std())


def left(error_um: np.ndarray) -> RunResidual:
    return RunResidual(run_of(np.zeros(len(error_um)), error_um), error_um)


def test_a_column_that_is_nowhere_changes_no_other():
    rng = np.random.default_rng(5)
    u = wave(600)
    view = TimeView(
        gain_um_per_V=1.0, play_r_V=(1.0, 2.0), play_w_um_per_V=(0.3, 0.2), u_range_V=(0.0, 8.0), rate_Hz=1000.0
    )
    of = modelled_run(AxisModel(time=view), run_of(u, 5 + u + 0.1 * rng.normal(size=600)))
    metric = metric_of([of], Noise(np.ones(1), 0.1, 0.2, 2.0, 1e-3, np.ones(1)))
    columns, fresh = rng.normal(size=(600, 4)).astype(np.float32), 30 + rng.normal(size=(600, 2))
    columns[:, 1] = 0.0
    made = whitened_regressors(metric, Layout((), 4), [SimulatedRegressors(of, of.answer(), columns)])
    total = made.with_columns([fresh]).sum(axis=0)
    every = metric.project(0, np.concatenate([columns, fresh], axis=1).astype(np.float64))
    assert np.allclose(total, every.T @ every, rtol=1e-6, atol=1e-4)
    assert np.allclose(made.total_with_columns([fresh]), total, rtol=1e-6, atol=1e-4)
    kept = made.restricted(np.array([2, 1, 0]))
    assert np.allclose(kept.total_with_columns([fresh])[:3, 3:], total[[2, 1, 0], 4:], rtol=1e-6, atol=1e-4)


def test_a_mode_that_always_rings_is_no_new_vibration():
    found = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        parts = [[left(ringing(rng, n, 190.0, 0.01) + 0.005 * rng.normal(size=n))] for n in (1500, 1000, 1500)]
        found += find_vibration("vibration", *parts) is not None
    assert found == 0


def test_a_new_vibration_is_found_where_it_is():
    rng = np.random.default_rng(2)
    quiet = [0.01 * rng.normal(size=n) for n in (4000, 3000, 4000)]
    shaken = [quiet[0] + ringing(rng, 4000, 120.0, 0.05), quiet[1] + ringing(rng, 3000, 120.0, 0.05), quiet[2]]
    found = find_vibration("vibration", *([left(e)] for e in shaken))
    assert found is not None
    assert abs(found.params["f_Hz"][0] - 120) < 10
    assert 0.005 < found.params["rms_um"][0] < 0.015


def test_a_line_at_the_mains_is_no_vibration():
    rng = np.random.default_rng(3)
    t = STEP_s * np.arange(4000)
    hum = 0.1 * np.sin(2 * np.pi * 50.02 * t)  # so strong that it is seen beside the lines that are left out
    parts = [[left(0.002 * rng.normal(size=4000) + share * hum)] for share in (1.0, 1.0, 0.0)]
    assert find_vibration("vibration", *parts) is None


@pytest.mark.parametrize("f_Hz", [50.0, 120.0])
def test_what_is_new_at_rest_is_noticed_whatever_it_is(f_Hz):
    rng = np.random.default_rng(3)
    line = 0.02 * np.sin(2 * np.pi * f_Hz * STEP_s * np.arange(4000))
    noises = [0.01 * rng.normal(size=4000) for _ in range(3)]
    new = [[left(noise + share * line)] for noise, share in zip(noises, (1.0, 1.0, 0.0), strict=True)]
    old = [[left(noise + line)] for noise in noises]
    assert louder_at_rest(*new)
    assert not louder_at_rest(*old)
    assert not louder_at_rest(new[0], new[1], [])  # nobody knows what was there before


def jittery(rng: np.random.Generator, f_Hz: float, rms_s: float, role: str) -> RunResidual:
    """A sine read at times that are off at random."""
    t = np.arange(6000) * STEP_s
    late = rms_s * rng.normal(size=len(t))
    ideal, speed = 20 * np.sin(2 * np.pi * f_Hz * t), 40 * np.pi * f_Hz * np.cos(2 * np.pi * f_Hz * t)
    error = 0.01 * rng.normal(size=len(t)) + late * speed
    return RunResidual(run_of(ideal / 10, ideal + error, role), error)


def test_a_clock_that_is_off_shows_on_all_records_alike():
    rng = np.random.default_rng(4)
    parts = [[jittery(rng, f, rms, role) for f in (5.0, 11.0)]
             for rms, role in ((2e-5, "train"), (2e-5, "holdout"), (0.0, "reference"))]  # fmt: skip
    found = find_jitter("sampling_jitter", *parts)
    assert found is not None
    assert found.params["rms_s"][0] == pytest.approx(2e-5, rel=0.1)
    assert find_jitter("sampling_jitter", parts[2], parts[2], parts[2]) is None


def test_fast_noise_on_one_record_alone_is_no_clock():
    rng = np.random.default_rng(5)
    odd = [[jittery(rng, 5.0, 0.0, role), jittery(rng, 11.0, 3e-5, role)] for role in ("train", "holdout")]
    still = [jittery(rng, f, 0.0, "reference") for f in (5.0, 11.0)]
    slow = [[jittery(rng, 5.0, 2e-4, role), jittery(rng, 11.0, 0.0, role)] for role in ("train", "holdout")]
    assert find_jitter("sampling_jitter", *slow, still) is None
    assert find_jitter("sampling_jitter", *odd, still) is None


def fast(rng: np.random.Generator, rms_s: float, role: str, missed_um: float = 0.0) -> RunResidual:
    """A sine of a fifth of the sampling rate whose amplitude swells, read by that clock, and a harmonic missed."""
    t = np.arange(6000) * STEP_s
    swell, w = 1 + np.sin(2 * np.pi * 0.7 * t), 2 * np.pi * 0.2 / STEP_s
    ideal, speed = 2 * swell * np.sin(w * t), 2 * swell * w * np.cos(w * t)
    error = 0.01 * rng.normal(size=len(t)) + rms_s * rng.normal(size=len(t)) * speed
    error += missed_um * swell * np.sin(w * t + 1)
    return RunResidual(run_of(ideal / 10, ideal + error, role), error)


@pytest.mark.parametrize("seed", range(4))
def test_the_size_of_a_jitter_is_right_however_fast_the_motion(seed):
    rng = np.random.default_rng(seed)
    parts = [[fast(rng, rms, role)] for rms, role in ((1e-5, "train"), (1e-5, "holdout"), (0.0, "reference"))]
    found = find_jitter("sampling_jitter", *parts)
    assert found is not None
    assert found.params["rms_s"][0] == pytest.approx(1e-5, rel=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_what_a_model_misses_of_fast_motion_is_no_clock(seed):
    rng = np.random.default_rng(seed)
    parts = [[fast(rng, 0.0, role, missed_um=0.05)] for role in ("train", "holdout")]
    assert find_jitter("sampling_jitter", *parts, [fast(rng, 0.0, "reference")]) is None


def test_noise_that_is_new_and_of_no_effect_allowed_is_said():
    rng = np.random.default_rng(6)
    parts = [[fast(rng, rms, role)] for rms, role in ((1e-5, "train"), (1e-5, "holdout"), (0.0, "reference"))]
    named, _, left_out = find_disturbances(*parts, {"sampling_jitter"})
    assert [f.name for f in named] == ["sampling_jitter"]
    assert not left_out
    named, untestable, left_out = find_disturbances(*parts, {"vibration"})
    assert not named
    assert list(untestable) == ["vibration"]
    assert "times the speed" in left_out[0]


@pytest.mark.parametrize("seed", range(4))
def test_a_narrow_vibration_in_a_short_record_is_found(seed):
    rng = np.random.default_rng(seed)
    b, a = [1.0], np.poly(np.exp([(-0.05 + 1j) * 2 * np.pi * 17 * STEP_s, (-0.05 - 1j) * 2 * np.pi * 17 * STEP_s]))

    def still(rms_um: float, role: str) -> RunResidual:
        shaken = lfilter(b, np.real(a), rng.normal(size=6500))[5000:]
        error = 0.01 * rng.normal(size=1500) + rms_um * shaken / shaken.std()
        return RunResidual(run_of(np.zeros(1500), error, role), error - error.mean())

    shaking = [[still(0.015, role)] for role in ("train", "holdout")]
    calm = [still(0.0, "reference")]
    found = find_vibration("vibration", *shaking, calm)
    assert found is not None
    assert abs(found.params["f_Hz"][0] - 17) < 6
    assert find_vibration("vibration", [still(0.0, "train")], [still(0.0, "holdout")], calm) is None
