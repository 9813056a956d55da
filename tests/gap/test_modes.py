"""Where a mode's refit starts: near one that was integrated on a finer grid, sharp or not, beside the base's own."""

from __future__ import annotations

import hashlib
from types import SimpleNamespace as Made

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from phaselead.gap.discrepancy import Discrepancy
from phaselead.gap.metric import metric_of, whitened_regressors
from phaselead.gap.noise import Noise
from phaselead.gap.records import GapRun
from phaselead.gap.refit import Fitted
from phaselead.gap.regressors import Layout, SimulatedRegressors
from phaselead.gap.residual import modelled_run
from phaselead.gap.scan import MODES_APART, is_mode, is_own_mode_moved, mode_starts
from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.model.effects import effect

RATE_Hz, FINE = 5000.0, 8


def mode(x: np.ndarray, f_Hz: float, zeta: float) -> np.ndarray:
    """Through a mode of static gain 1, on the fine grid."""
    w = 2 * np.pi * f_Hz
    system = [[0, 1], [-w * w, -2 * zeta * w]], [[0], [w * w]], [[1, 0]], [[0]]
    ad, bd, *_ = cont2discrete([np.array(m, dtype=float) for m in system], 1 / (FINE * RATE_Hz))
    b = [0, bd[0, 0], ad[0, 1] * bd[1, 0] - ad[1, 1] * bd[0, 0]]
    return lfilter(b, [1, -np.trace(ad), np.linalg.det(ad)], x)


def started(f_Hz: float, zeta: float, share: float) -> list[dict[str, float]]:
    """Starts for steps of a stage with a mode at 250 Hz, and another that carries a share of its motion."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(0, 8, 6), 700)
    u[:200] = 0.0
    base = mode(3 * np.repeat(u, FINE), 250.0, 0.03)
    x = (base + share * (mode(base, f_Hz, zeta) - base))[FINE - 1 :: FINE] + 0.01 * rng.normal(size=len(u))
    own = AdoptedEffect(name="resonance", params={"c": (1.0,), "f_Hz": (250.0,), "zeta": (0.03,)})
    axis = AxisModel(time=TimeView(gain_um_per_V=3.0, u_range_V=(0.0, 8.0), rate_Hz=RATE_Hz), effects=(own,))
    digest = hashlib.sha256(x.tobytes()).hexdigest()
    run = GapRun("x", "train", np.arange(len(u)) / RATE_Hz, u, x, None, 0, len(u), "made.csv", digest, {}, {})
    of = modelled_run(axis, run)
    metric = metric_of([of], Noise(np.ones(1), 0.01, 0.02, 2.0, 1e-3, np.ones(1)))
    made = whitened_regressors(
        metric, Layout((), 1), [SimulatedRegressors(of, of.answer(), rng.normal(size=(len(u), 1)).astype(np.float32))]
    )
    nothing = Discrepancy(np.zeros(1, dtype=np.intp), np.zeros(1), np.eye(1))
    starts = mode_starts(made, nothing, Fitted((), 0.0), effect("resonance"))
    return [dict(entries[-1][1]) for entries in starts]


@pytest.mark.parametrize(("f_Hz", "zeta"), [(407.0, 0.01), (331.0, 0.006), (520.0, 0.04), (185.0, 0.02)])
def test_one_of_the_starts_is_in_the_valley_of_the_mode(f_Hz, zeta):
    first, second = started(f_Hz, zeta, 0.5)
    nearest = min(first, second, key=lambda start: abs(start["f_Hz"] - f_Hz))
    assert nearest["f_Hz"] == pytest.approx(f_Hz, rel=0.04)
    assert 0.1 < nearest["c"] < 0.9
    assert not 1 / MODES_APART < second["f_Hz"] / first["f_Hz"] < MODES_APART


def test_of_all_effects_the_resonance_alone_is_told_by_a_sharp_frequency():
    assert is_mode(effect("resonance"))
    assert not any(is_mode(effect(name)) for name in ("load_change", "vibration", "delay", "hysteresis", "mains_hum"))


@pytest.mark.parametrize(
    ("f_Hz", "c", "reference", "moved"),
    [
        (262.0, 0.1, True, True),
        (430.0, -0.1, True, True),
        (262.0, 0.6, True, False),  # it carries most of the motion
        (330.0, 0.1, True, False),
        (262.0, 0.1, False, False),  # the base was not fitted to anything
    ],
)
def test_a_small_mode_where_the_base_has_one_is_that_one_moved(f_Hz, c, reference, moved):
    own = AdoptedEffect(name="resonance", params={"c": (0.9, 0.1), "f_Hz": (250.0, 420.0), "zeta": (0.03, 0.03)})
    bench = Made(reference=Made() if reference else None, axis=Made(effects=(own,)))
    assert is_own_mode_moved(bench, (effect("resonance"), {"c": c, "f_Hz": f_Hz, "zeta": 0.02})) is moved
    assert not is_own_mode_moved(bench, (effect("load_change"), {"mass": 0.1}))
