"""Records of a closed loop: feedback puts the sensor's noise into the voltage, and that is no drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from phaselead.identify.fitting import fit
from phaselead.identify.modal.shown_modes import measured_response
from phaselead.identify.runs import AxisRun, axis_run
from phaselead.record.recording import AxisRecord, Recording

RATE_HZ, GAIN, POLE = 5000.0, 10.0, 0.3


def tracked(r_um: np.ndarray, noise_um: float = 0.01, integral: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """Voltage and measured position (n,) of a stage with a lag of three rows, under an integrator and a share of the
    error, row by row."""
    noise = noise_um * np.random.default_rng(4).standard_normal(len(r_um))
    u, x, moved, held = np.zeros(len(r_um)), np.zeros(len(r_um)), 0.0, 0.0
    for i, wanted in enumerate(r_um):
        x[i] = moved + noise[i]
        error = wanted - x[i]
        held += integral * error
        u[i] = held + 0.01 * error
        moved += POLE * (GAIN * u[i] - moved)
    return u, x


def run_of(path_um: np.ndarray, *, told: bool = True) -> AxisRun:
    u, x = tracked(path_um)
    return AxisRun(np.arange(len(u)) / RATE_HZ, u, x, slice(0, len(u)), "x", "run", path_um if told else None)


T_s = np.arange(20_000) / RATE_HZ
SINE_um = 30 * (1 - np.cos(2 * np.pi * 5 * T_s))


def test_noise_that_goes_round_the_loop_is_no_response():
    asked = measured_response([run_of(SINE_um)])
    assert len(asked.f_Hz) > 0
    assert asked.f_Hz.max() < 30
    assert not asked.broadband
    # Of the voltage alone nobody can tell: it was taken for drive up to half the rate.
    assert measured_response([run_of(SINE_um, told=False)]).f_Hz.max() > 2000


def test_a_path_of_many_frequencies_shows_the_stage_and_not_the_controller():
    f_Hz = np.arange(4, 400, 4.0)
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, len(f_Hz))
    path_um = np.sin(2 * np.pi * f_Hz[:, None] * T_s + phases[:, None]).sum(axis=0)
    found = measured_response([run_of(path_um)])
    assert found.broadband
    assert 350 < found.f_Hz.max() < 450
    z = np.exp(-2j * np.pi * found.f_Hz / RATE_HZ)
    truth = GAIN * POLE * z / (1 - (1 - POLE) * z)
    clear = found.std < 0.02 * np.abs(found.value)
    assert clear.sum() > 50
    assert found.value[clear] == pytest.approx(truth[clear], rel=0.05)


def test_fit_says_no_more_of_modes_than_the_path_can_tell():
    u, x = tracked(SINE_um)
    record = Recording(T_s, {"x": AxisRecord(u, x, SINE_um)}, source="run.h5")
    said = " ".join(fit([record])[1].messages)
    assert "no mode seen" in said
    assert "shows no mode up to" not in said


@pytest.mark.parametrize(
    "path", [lambda r: r / 1000, lambda r: np.full(len(r), 5.0), lambda r: np.full(len(r), np.nan), lambda r: -r]
)
def test_what_the_stage_did_not_follow_is_no_path(path):
    """A set point in millimetres, a constant one, one with gaps: the record is as good as without."""
    f_Hz = np.arange(4, 400, 4.0)
    u = np.sin(2 * np.pi * f_Hz[:, None] * T_s + np.arange(len(f_Hz))[:, None] ** 2).sum(axis=0)
    x = lfilter([0, GAIN * POLE], [1, POLE - 1], u) + 0.01 * np.random.default_rng(2).standard_normal(len(u))
    plain = axis_run(Recording(T_s, {"x": AxisRecord(u, x)}), "x")
    beside = axis_run(Recording(T_s, {"x": AxisRecord(u, x, path(GAIN * u))}), "x")
    assert np.array_equal(measured_response([beside]).f_Hz, measured_response([plain]).f_Hz)
    assert measured_response([plain]).broadband


def test_short_records_with_and_without_a_path_do_not_mix():
    """One is in um and the other in V: pooled, the unit of the voltage decided which of them counts."""
    f_Hz = np.arange(20, 400, 20.0)
    path_um = np.sin(2 * np.pi * f_Hz[:, None] * T_s[:500] + np.arange(len(f_Hz))[:, None] ** 2).sum(axis=0)
    runs = [run_of(path_um)] * 4 + [run_of(path_um, told=False)] * 4
    in_V, in_mV = (measured_response([replace(run, u_V=unit * run.u_V) for run in runs]) for unit in (1, 1000))
    assert len(in_V.f_Hz) > 0
    assert np.array_equal(in_mV.f_Hz, in_V.f_Hz)
    assert 1000 * in_mV.value == pytest.approx(in_V.value)
