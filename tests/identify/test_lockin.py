"""Lock-in: known sines come back within their stated errors, and bad records are refused."""

from __future__ import annotations

import numpy as np
import pytest
from bench_stage import BenchStage, record, rising_sine, sine_record
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.errors import BadInput
from phaselead.identify.runs import axis_run, turning_points
from phaselead.identify.table import LockIn, lock_in
from phaselead.record.recording import Recording


def answer(
    swing_V: float,
    f_Hz: float,
    gain: float = 20.0,
    theta_deg: float = 5.0,
    x0_um: float = 3.0,
    *,
    periods: float = 5,
    rate_Hz: float = 1000.0,
    noise_um: float = 0.0,
    seed: int = 0,
) -> Recording:
    """A stage that obeys eq. 5 of the paper from the first row on."""
    t, u = rising_sine(swing_V, f_Hz, periods, rate_Hz)
    half = swing_V / 2
    x = gain * half * (1 - np.cos(2 * np.pi * f_Hz * t - np.deg2rad(theta_deg))) + x0_um
    return record(t, u, x + np.random.default_rng(seed).normal(0, noise_um, len(t)) if noise_um else x)


def point_of(recording: Recording, f_Hz: float | None = None) -> LockIn:
    return lock_in(axis_run(recording, "x"), f_Hz)


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.2, 10),
    st.floats(0.7, 20),
    st.floats(1, 30),
    st.floats(-40, 120),
    st.floats(-50, 50),
    st.sampled_from([700.0, 1000.0, 1234.5]),
)
def test_returns_gain_phase_and_offset(swing_V, f_Hz, gain, theta_deg, x0_um, rate_Hz):
    """Whatever the rate: periods need not be a whole number of rows."""
    point = point_of(answer(swing_V, f_Hz, gain, theta_deg, x0_um, rate_Hz=rate_Hz, periods=6))
    assert point.f_Hz == pytest.approx(f_Hz, rel=2e-5)
    assert point.swing_V == pytest.approx(swing_V, rel=1e-3)
    assert point.gain_um_per_V == pytest.approx(gain, rel=1e-3)
    assert point.phase_deg == pytest.approx(theta_deg, abs=0.05)
    assert point.x0_um == pytest.approx(x0_um, abs=2e-3 * gain * swing_V)


def test_stated_errors_cover_the_truth():
    """Over 300 noisy records the truth lies within two stated deviations about as often as it should, or
    more."""
    inside = []
    for seed in range(300):
        p = point_of(answer(2.0, 5.0, noise_um=0.5, seed=seed), 5.0)
        inside.append(
            (
                abs(p.gain_um_per_V - 20) < 2 * p.gain_std,
                abs(p.phase_deg - 5) < 2 * p.phase_std,
                abs(p.x0_um - 3) < 2 * p.x0_std,
            )
        )
    share = np.mean(inside, axis=0)
    assert np.all(share > 0.9), share
    assert np.all(share < 0.995), f"the errors are stated far too large: {share}"


def test_errors_count_what_differs_between_periods():
    """A gain that wanders from period to period shows in the error, though the sensor is quiet."""
    t, u = rising_sine(2.0, 5.0, 8, 1000.0)
    stated = []
    for seed in range(30):
        wander = 1 + 0.001 * np.repeat(np.random.default_rng(seed).normal(size=8), 200)
        stated.append(point_of(record(t, u, 20 * u * wander), 5.0).gain_std)
    assert np.mean(stated) == pytest.approx(0.02 / np.sqrt(7), rel=0.15)


def test_refers_to_the_applied_voltage_latency_included():
    """One tick of latency at 20 Hz and 5 kHz is 1.44 degrees of lag."""
    quick = BenchStage(r=(), w=(), d=(), s=(), creep=(), mode_Hz=0, noise_um=0, delay_ticks=1)
    p = point_of(sine_record(quick, 4, 20))
    assert p.phase_deg == pytest.approx(1.44, abs=1e-3)


def test_the_window_decides_what_has_settled():
    stage = BenchStage()
    whole, settled = sine_record(stage, 4, 10), sine_record(stage, 4, 10, settle=2)
    assert point_of(whole).periods == 4  # the first settles
    assert point_of(settled).periods == 3
    assert point_of(settled).gain_um_per_V == pytest.approx(point_of(whole).gain_um_per_V, rel=1e-3)


def test_rest_before_and_after_does_not_count():
    t, u = rising_sine(4, 10, 5, 5000)
    quiet = BenchStage().quiet()
    bare = point_of(record(t, u, quiet.measure(u, 5000)))
    u = np.concatenate([np.zeros(777), u, np.zeros(1234)])
    padded = point_of(record(np.arange(len(u)) / 5000, u, quiet.measure(u, 5000)))
    assert padded.periods == bare.periods
    assert padded.gain_um_per_V == pytest.approx(bare.gain_um_per_V, rel=1e-4)
    assert padded.phase_deg == pytest.approx(bare.phase_deg, abs=0.02)


def relaxing() -> Recording:
    recording = answer(4, 5, periods=6)
    x = recording.axes["x"].x_um * (1 + 0.5 * np.exp(-recording.t_s))
    return record(recording.t_s, recording.axes["x"].u_V, x)


def triangle() -> Recording:
    t = np.arange(5000) / 1000
    u = 2 * np.abs((t % 1.0) - 0.5)
    return record(t, u, 10 * u)


@pytest.mark.parametrize(
    ("recording", "message"),
    [
        (answer(4, 5, periods=2), "2 whole periods of 5 Hz are too few; record at least 3"),
        (answer(4, 100, periods=50, rate_Hz=1000), "rows per period are too few; sample at"),
        (relaxing(), "no steady state"),
        (triangle(), "no sine"),
    ],
)
def test_refuses(recording, message):
    with pytest.raises(BadInput, match=message) as caught:
        point_of(recording)
    assert "\n" not in str(caught.value)


def test_clipped_position_is_refused():
    recording = answer(4, 5)
    x = np.minimum(recording.axes["x"].x_um, 60.0)
    with pytest.raises(BadInput, match="clipped"):
        point_of(record(recording.t_s, recording.axes["x"].u_V, x))


def test_turning_points_ignore_ripple():
    t = np.linspace(0, 3, 3000)
    assert turning_points(np.sin(2 * np.pi * t) + 0.02 * np.sin(80 * t)) == 6
    assert turning_points(t) == 0
