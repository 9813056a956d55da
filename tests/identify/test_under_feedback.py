"""Records of a closed loop: feedback puts the sensor's noise into the voltage, and that is no drive."""

from __future__ import annotations

import numpy as np
import pytest

from phaselead.identify.fitting import fit
from phaselead.identify.modal.shown_modes import measured_response
from phaselead.identify.runs import AxisRun
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
    assert "no mode looked for" in said
    assert "shows no mode up to" not in said
