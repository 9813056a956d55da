"""An operator and a mode, each fitted with the other in place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from phaselead.identify.modal import one_axis
from phaselead.identify.modal.one_axis import FittedModes, fit_together
from phaselead.identify.modal.shown_modes import ShownModes
from phaselead.identify.operator import OperatorFit, fit_operator
from phaselead.identify.runs import AxisRun, period_s

RATE_HZ, F_HZ, ZETA = 5000.0, 260.0, 0.02


def plays(u: np.ndarray) -> np.ndarray:
    """A line and two plays, the memory at rest at 0 V."""
    x = 8.0 * u
    for r, w in ((0.3, 2.0), (1.0, 2.0)):
        at, way = 0.0, []
        for now in u.tolist():
            at = max(now - r, min(now + r, at))
            way.append(at)
        x = x + w * np.array(way)
    return x


def ringing(u: np.ndarray, seed: int) -> np.ndarray:
    """Behind a mode integrated on a grid eight times finer, with noise."""
    rows = np.arange(len(u))
    fine = np.interp(np.arange(0, len(u), 1 / 8), rows, plays(u))
    w = 2 * np.pi * F_HZ
    b, a, _ = cont2discrete(([w * w], [1, 2 * ZETA * w, w * w]), 1 / (8 * RATE_HZ), method="foh")
    return lfilter(np.ravel(b), a, fine)[::8] + 0.01 * np.random.default_rng(seed).standard_normal(len(u))


def run(u: np.ndarray, name: str, seed: int) -> AxisRun:
    return AxisRun(np.arange(len(u)) / RATE_HZ, u, ringing(u, seed), slice(None), "x", name)


@pytest.fixture(scope="module")
def runs() -> list[AxisRun]:
    t = np.arange(4000) / RATE_HZ
    steps = np.repeat([0.0, 5.0, 1.5, 7.0, 3.0, 0.0], 700)
    sine = 4 - 4 * np.cos(2 * np.pi * 60 * t)
    triangle = 8 * (1 - np.abs(2 * ((t * 5) % 1) - 1))
    rng, led_in = np.random.default_rng(3), np.sin(np.pi / 2 * np.minimum(t / 0.1, 1)) ** 2
    lines = sum(np.cos(2 * np.pi * f * t + rng.uniform(0, 6)) for f in range(10, 1200, 37))
    waves = {"steps": steps, "sine": sine, "triangle": triangle, "lines": led_in * (4 + lines / np.abs(lines).max())}
    return [run(u, name, i) for i, (name, u) in enumerate(waves.items())]


def assert_parted(operator: OperatorFit, mode: FittedModes | None, runs: list[AxisRun]) -> None:
    assert mode is not None
    (_, f_Hz, zeta), *_ = mode.modes
    assert f_Hz == pytest.approx(F_HZ, rel=0.002)
    assert zeta == pytest.approx(ZETA, rel=0.05)
    assert operator.view.residual_um_rms < 0.25 * fit_operator(runs).view.residual_um_rms


def test_operator_and_mode_part(runs):
    operator, mode = fit_together(runs)
    assert_parted(operator, mode, runs)


def test_they_part_from_the_ringing_alone_too(runs, monkeypatch):
    """Where no response shows the mode, the fit starts from what rings in the operator's residual."""
    monkeypatch.setattr(one_axis, "modes_shown", lambda response: ShownModes((), 0.0))
    operator, mode = fit_together(runs)
    assert_parted(operator, mode, runs)


def test_a_stage_that_does_not_ring_keeps_its_operator(runs):
    calm = [replace(r, x_um=plays(r.u_V) + 0.01 * np.random.default_rng(i).standard_normal(len(r.u_V)))
            for i, r in enumerate(runs)]  # fmt: skip
    operator, mode = fit_together(calm)
    assert mode is None
    assert operator.view == fit_operator(calm).view


def test_a_voltage_that_only_jumps_has_no_period(runs):
    assert period_s(runs[0]) == np.inf
