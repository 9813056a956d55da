"""What a mode still rings of, when a record at rest begins, is the stage's own: no vibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from phaselead.gap.findings import GapSize
from phaselead.gap.goodness_of_fit import FinalFit
from phaselead.gap.records import GapRun
from phaselead.gap.residual import modelled_run
from phaselead.model import AdoptedEffect, AxisModel, TimeView, effect
from phaselead.validation.trial import try_case

TRUTH = str(Path(__file__).parent / "truth")
STEP_s, ROWS, NOISE_um = 2e-4, 7500, 1e-3
MODE_Hz, ZETA = 180.0, 0.012
MODE = AdoptedEffect(name="resonance", params={"f_Hz": MODE_Hz, "zeta": ZETA})
VIEW = TimeView(gain_um_per_V=10.0, u_range_V=(0.0, 10.0), rate_Hz=1 / STEP_s)
LOADED = (effect("load_change"), {"mass": 0.1})
MOVED_Hz = MODE_Hz / np.sqrt(1.1)


def power_left(moves_um, role="train", entries=(LOADED,), mode=MODE):
    """Of a record at rest with this motion and noise, beside that of the noise."""
    noise = NOISE_um * np.random.default_rng(5).normal(size=ROWS)
    t_s = STEP_s * np.arange(ROWS)
    run = GapRun("x", role, t_s, np.zeros(ROWS), moves_um + noise, None, 0, ROWS, "rest.csv", {}, {})
    modelled = modelled_run(AxisModel(time=VIEW, effects=(mode,)), run)
    final = FinalFit(modelled.axis, entries, (modelled,), (modelled,), GapSize(1.0, 1.0, 1.0))
    (left,) = final.without_ringing(role)
    return float(np.mean(left.error_um**2)) / NOISE_um**2


def ring(f_Hz, zeta=ZETA, phase=0.3):
    turn = 2 * np.pi * f_Hz * STEP_s * np.arange(ROWS)
    return 0.05 * np.exp(-zeta * turn) * np.cos(turn + phase)


@pytest.mark.parametrize("off", [1.0, 1.003, 0.997])
def test_what_rings_at_the_moved_mode_is_taken_out(off):
    assert np.mean(ring(MOVED_Hz) ** 2) > 20 * NOISE_um**2
    assert power_left(ring(off * MOVED_Hz, ZETA / np.sqrt(1.1))) < 1.5


def test_reference_records_ring_at_the_mode_as_it_was():
    assert power_left(ring(MODE_Hz), "reference") < 1.5
    assert power_left(ring(MODE_Hz)) > 5


@pytest.mark.parametrize("zeta", [0.005, 0.012, 0.05])
@pytest.mark.parametrize("f_Hz", [40.0, 80.0, 180.0, 300.0])
def test_what_does_not_die_away_stays(f_Hz, zeta):
    """A vibration of the floor is often at a mode."""
    mode = AdoptedEffect(name="resonance", params={"f_Hz": f_Hz, "zeta": zeta})
    steady = 5e-3 * np.sqrt(2) * np.cos(2 * np.pi * f_Hz * STEP_s * np.arange(ROWS))
    assert power_left(steady, entries=(), mode=mode) > 0.9 * np.mean(steady**2) / NOISE_um**2


@pytest.mark.parametrize("seed", range(4))
def test_a_narrow_vibration_at_a_mode_mostly_stays(seed):
    """As a lightly damped floor answers noise: its amplitude wanders."""
    turn = np.exp((2j * np.pi * MODE_Hz - 2 * np.pi * 2.0) * STEP_s)
    force = np.random.default_rng(seed).normal(size=ROWS + 2000)
    wandering = lfilter([1.0], [1.0, -2 * turn.real, abs(turn) ** 2], force)[2000:]
    wandering *= 5e-3 / wandering.std()
    assert power_left(wandering, entries=()) > 0.5 * 25


@pytest.mark.trial
def test_a_load_is_no_vibration_where_the_mode_that_it_moved_rings_out():
    outcome = try_case(TRUTH, "tuning/single/load_change/1/fast/16", follow_up=False)
    assert outcome["verdicts"] == ["named"]
    assert outcome["named"] == ["load_change"]
