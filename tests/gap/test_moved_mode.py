"""A mode that moved is a load, whatever became of its damping. The stages are made here, of plays and a filter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import phaselead as pl
from phaselead.gap import run_gap
from phaselead.model import catalogue
from phaselead.report.gap import gap_page

RATE_HZ, FINER = 5000.0, 4
F_HZ, ZETA = 220.0, 0.03


def driven(u_V: np.ndarray, f_Hz: float, zeta: float, seed: int) -> np.ndarray:
    """Where three plays behind a slope put a mode, in um, with 6 nm of noise."""
    u = np.repeat(u_V, FINER)
    moved = 8.0 * u
    for r_V, weight in ((0.5, 0.6), (1.5, 0.5), (3.0, 0.3)):
        stood, at = np.empty_like(u), 0.0
        for i, volt in enumerate(u):
            at = min(max(at, volt - r_V), volt + r_V)
            stood[i] = at
        moved += weight * stood
    w = 2 * np.pi * f_Hz
    over, under, _ = cont2discrete(([w * w], [1, 2 * zeta * w, w * w]), 1 / (RATE_HZ * FINER))
    noise_um = np.random.default_rng(seed).normal(0, 0.006, len(u_V))
    return lfilter(over.ravel(), under, moved)[::FINER] + noise_um


def session(seed: int, f_Hz: float = F_HZ, zeta: float = ZETA) -> list[pl.Recording]:
    """A rest, a fading triangle, a multisine through the mode and steps."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(5000) / RATE_HZ
    rising = np.linspace(0, 1, 500)
    lines = sum(np.sin(2 * np.pi * f * t_s + rng.uniform(0, 2 * np.pi)) for f in range(5, 400, 7))
    multisine = 5 + 2 * lines / np.ptp(lines)
    waves = {
        "rest": np.zeros(5000),
        "triangle": np.concatenate([top * np.r_[rising, rising[::-1]] for top in rng.uniform([8, 6, 4], [10, 8, 6])]),
        "multisine": np.concatenate([rising * multisine[0], multisine, multisine]),
        "steps": np.repeat(rng.uniform(0, 8, 6), 1000) * (np.arange(6000) >= 500),
    }
    made = []
    for name, u_V in waves.items():
        x_um = driven(u_V, f_Hz, zeta, int(rng.integers(2**31)))
        made.append(pl.recording(t_s=np.arange(len(u_V)) / RATE_HZ, u_V=u_V, x_um=x_um, source=f"{name}{seed}"))
    return made


@pytest.fixture(scope="module")
def reference() -> list[pl.Recording]:
    return session(1)


@pytest.fixture(scope="module")
def model(reference: list[pl.Recording]) -> pl.FitResult:
    return pl.fit(reference[1:])


@pytest.mark.parametrize(
    ("f_Hz", "zeta"),
    [
        (205.0, 0.03),
        pytest.param(205.0, 0.06, marks=pytest.mark.trial),
        pytest.param(235.0, 0.03, marks=pytest.mark.trial),
        pytest.param(220.0, 0.05, marks=pytest.mark.trial),
        pytest.param(190.0, ZETA * 190 / 220, marks=pytest.mark.trial),
    ],
)
def test_a_mode_that_moved_is_a_load_whatever_became_of_its_damping(reference, model, f_Hz, zeta):
    """A load of a mass alone left a twentieth of the motion, and nothing was named or adopted."""
    found = pl.gap(model, train=session(2, f_Hz, zeta), holdout=session(3, f_Hz, zeta), reference=reference)
    assert found.verdicts == ("named",)
    (load,) = found.effects
    assert load.name == "load_change"
    mass, damping = (load.params[name] for name in ("mass", "damping"))
    true_mass = (F_HZ / f_Hz) ** 2 - 1
    for (value, _, (low, high)), true in ((mass, true_mass), (damping, zeta / ZETA * (1 + true_mass) ** 0.5 - 1)):
        assert low - 0.005 <= true <= high + 0.005
        assert value == pytest.approx(true, abs=0.02)
    assert found.gap.after < 0.05 * found.gap.before
    assert found.in_words(load).startswith(f"the mode at {F_HZ:g} Hz (zeta 0.03) is at ")
    assert float(found.in_words(load).split(" is at ")[1].split()[0]) == pytest.approx(f_Hz, abs=0.5)
    assert found.in_words(load) in gap_page(found, "model.toml")


def test_where_loads_are_not_looked_for_the_mode_has_no_name(reference, model):
    """A resonance whose zeros take the known mode away describes it, and is adopted without its name."""
    others = tuple(name for name in catalogue() if name not in ("resonance", "delay", "gain_change"))
    moved, again = session(2, 205.0), session(3, 205.0)
    found = run_gap(model.model, moved, again, reference, without=others)
    assert found.verdicts == ("unknown",)
    assert [(one.name, one.status) for one in found.adopted] == [("resonance", "provisional")]
    assert found.gap.after < 0.1 * found.gap.before
    assert "resonance has its zeros where the model has a mode, so that it may be that mode, changed" in found.messages
