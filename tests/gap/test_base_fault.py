"""What a base may lack in all records is small: it looks so whatever was found of the same kind in the new ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import chirp

from phaselead.gap.posterior.base_fault import as_fault
from phaselead.gap.records import GapRun
from phaselead.gap.residual import modelled_run
from phaselead.model import AdoptedEffect, AxisModel, TimeView, effect

STEP_s = 5e-4
T_s = STEP_s * np.arange(8000)
VIEW = TimeView(gain_um_per_V=8.0, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s)
MODE = AdoptedEffect(name="resonance", params={"f_Hz": 220.0, "zeta": 0.02})
U_V = 4 + 3 * chirp(T_s, 1.0, 4.0, 500.0)
RUN = GapRun("x", "train", T_s, U_V, 8 * U_V, None, 0, len(T_s), "made.csv", {}, {})


def column(name, **sizes):
    """Of the first parameter, of unit length."""
    one = effect(name)
    made = as_fault(modelled_run(AxisModel(time=VIEW, effects=(MODE,)), RUN), [(one, {**one.typical, **sizes})])[:, 0]
    return made / np.linalg.norm(made)


@pytest.mark.parametrize("name", ["delay", "amplifier_lowpass", "sensor_lowpass"])
@pytest.mark.parametrize("times", [5.0, 20.0])
def test_a_lag_that_the_base_lacks_looks_like_a_small_one(name, times):
    (size,) = effect(name).sizes
    small = column(name, **{size.name: 0.05 * size.typical})
    assert column(name, **{size.name: times * size.typical}) @ small > 0.9


@pytest.mark.parametrize(
    ("name", "params"),
    [("saturation", {"top": 0.2, "bottom": 0.0}), ("slew_limit", {"traverse_s": 0.3, "loop_s": 2e-5})],
)
def test_what_shows_beyond_a_size_alone_may_be_lacking_at_that_size(name, params):
    """At its typical size it does nothing in this record."""
    u_V = 4 + 3 * np.sin(2 * np.pi * 2 * T_s)
    one, modelled = effect(name), modelled_run(AxisModel(time=VIEW), replace(RUN, u_V=u_V, x_um=8 * u_V))
    typical = {**params, **{size.name: 0.01 for size in one.sizes}}
    assert np.ptp(modelled.answer([(one, typical)]) - modelled.answer()) < 1e-4
    assert np.linalg.norm(as_fault(modelled, [(one, params)]), axis=0)[0] > 1.0


def test_shapes_are_as_near_as_the_found_ones():
    one = effect("hysteresis")
    modelled = modelled_run(AxisModel(time=VIEW), RUN)
    small, large = (as_fault(modelled, [(one, {**one.typical, "width": w})])[:, 2:] for w in (0.12, 0.48))
    assert np.allclose(large, 4 * small)
