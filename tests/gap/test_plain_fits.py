"""Effects fitted one by one in um: a mode from far away, sharp or not, beside the base's own, and none at an end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from phaselead.gap.least_squares import fitted_in_um
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior import each_fitted, likelihood_of
from phaselead.gap.posterior.starts import Starts
from phaselead.gap.records import GapRun
from phaselead.gap.residual import modelled_run
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


def stepped(x_of_steps):
    """Steps of a stage with a mode at 250 Hz, of which the base knows; ``x_of_steps`` takes its motion on the fine
    grid."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(0, 8, 6), 700)
    u[:200] = 0.0
    x = x_of_steps(mode(3 * np.repeat(u, FINE), 250.0, 0.03))[FINE // 2 :: FINE] + 0.01 * rng.normal(size=len(u))
    own = AdoptedEffect(name="resonance", params={"c": (1.0,), "f_Hz": (250.0,), "zeta": (0.03,)})
    axis = AxisModel(time=TimeView(gain_um_per_V=3.0, u_range_V=(0.0, 8.0), rate_Hz=RATE_Hz), effects=(own,))
    run = GapRun("x", "train", np.arange(len(u)) / RATE_Hz, u, x, None, 0, len(u), "made.csv", {}, {})
    return modelled_run(axis, run)


def fitted(x_of_steps, names) -> list[SizedEffect]:
    return each_fitted([stepped(x_of_steps)], [effect(name) for name in names])


@pytest.mark.parametrize(("f_Hz", "zeta"), [(407.0, 0.01), (331.0, 0.006), (520.0, 0.04), (185.0, 0.02)])
def test_a_mode_is_found_from_far_away(f_Hz, zeta):
    best, params = fitted(lambda x: x + 0.5 * (mode(x, f_Hz, zeta) - x), ("gain_change", "resonance", "delay"))[0]
    assert best.name == "resonance"
    assert params["f_Hz"] == pytest.approx(f_Hz, rel=0.01)
    assert params["c"] == pytest.approx(0.5, rel=0.1)
    assert params["zeta"] == pytest.approx(zeta, rel=0.2)


def test_a_mode_is_begun_in_two_valleys():
    """Not at two frequencies beside one another: of those one would do."""
    likelihood = likelihood_of([stepped(lambda x: 0.7 * x + 0.3 * mode(x, 120.0, 0.02))])
    starts = Starts(likelihood, [effect("resonance")]).beside(likelihood.fit(()))["resonance"]
    first, second = (start.entry[1]["f_Hz"] for start in starts)
    assert first == pytest.approx(120.0, rel=0.05)
    assert not 1 / 1.5 < second / first < 1.5


def test_the_effect_that_leaves_least_comes_first():
    found = fitted(lambda x: 1.04 * x, ("delay", "gain_change", "sensor_lowpass", "resonance"))
    assert found[0][0].name == "gain_change"
    assert found[0][1]["gain"] == pytest.approx(0.04, rel=0.02)


def test_an_effect_as_large_as_it_can_be_imitates_another():
    """The gain is off by 4 %; one that may be off by 1 % at most stands at that end, and is left out."""
    gain = effect("gain_change")
    small = replace(gain, parameters=tuple(replace(p, low=-0.01, high=0.01) for p in gain.parameters))
    run = stepped(lambda x: 1.04 * x)
    (entry,), _ = fitted_in_um([(small, {"gain": 0.002})], [run], np.concatenate, 12)
    assert entry[1]["gain"] == pytest.approx(0.01, rel=1e-6)
    assert [e.name for e, _ in each_fitted([run], [gain])] == ["gain_change"]
    assert each_fitted([run], [small]) == []


def test_a_frequency_stays_below_what_the_sampling_shows():
    run = stepped(lambda x: x + 0.05 * np.sin(0.35 * np.arange(len(x))))
    start = (effect("resonance").as_sampled(0.45 * RATE_Hz), {"c": 0.5, "f_Hz": 4000.0, "zeta": 0.02})
    (entry,), _ = fitted_in_um([start], [run], np.concatenate, 3)
    assert entry[1]["f_Hz"] <= 0.45 * RATE_Hz


def test_nothing_is_fitted_where_nothing_is_asked():
    assert fitted(lambda x: x, ()) == []
