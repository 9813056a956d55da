"""The first modes are found where there are some, and not where there are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim, lti

from phaselead.identify.mode_fit import fit_modes
from phaselead.identify.runs import AxisRun
from phaselead.model.axis import TimeView

RATE_HZ = 5000.0
VIEW = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 10.0), rate_Hz=RATE_HZ, delay_s=0.0002)


def triangle_run(f_Hz: float, mode: tuple[float, float] | None, seed: int) -> AxisRun:
    """A triangle (its corners ring) through a linear stage with this mode, integrated by scipy's own simulator."""
    t_s = np.arange(round(4 / f_Hz * RATE_HZ)) / RATE_HZ
    u_V = 5 * (1 - np.abs(2 * ((t_s * f_Hz) % 1.0) - 1))
    late_V = np.interp(t_s - VIEW.delay_s, t_s, u_V, left=0.0)
    x_um = 20 * late_V
    if mode is not None:
        w, zeta = 2 * np.pi * mode[0], mode[1]
        _, x_um, _ = lsim(lti([20 * w**2], [1, 2 * zeta * w, w**2]), late_V, t_s)
    x_um = x_um + 0.01 * np.random.default_rng(seed).standard_normal(len(t_s))
    return AxisRun(t_s, u_V, x_um, slice(len(t_s) // 4, None), "x", f"{f_Hz:g} Hz")


@pytest.mark.parametrize("mode", [(160.0, 0.02), (333.0, 0.05), (60.0, 0.1)])
def test_a_mode_is_found_and_its_lag_taken_out_of_the_delay(mode):
    runs = [triangle_run(f, mode, i) for i, f in enumerate((3.0, 5.0, 7.0, 11.0))]
    zeta_lag_s = 2 * mode[1] / (2 * np.pi * mode[0])
    view = VIEW.model_copy(update={"delay_s": VIEW.delay_s + zeta_lag_s})  # what a fit without a mode would call delay
    found = fit_modes(view, runs)
    assert found is not None
    assert len(found.modes) == 1
    assert found.modes[0] == pytest.approx((1.0, *mode), rel=0.1)
    assert found.modes[0][1] == pytest.approx(mode[0], rel=0.01)
    assert found.delay_s == pytest.approx(VIEW.delay_s, abs=3e-5)
    assert found.left < 0.1


def test_a_second_mode_and_its_share_are_found():
    runs = [triangle_run(f, (160.0, 0.02), i) for i, f in enumerate((3.0, 5.0, 7.0, 11.0))]
    w, zeta, share = 2 * np.pi * 490.0, 0.03, 0.05
    both = []
    for run in runs:
        late_V = np.interp(run.t_s - VIEW.delay_s, run.t_s, run.u_V, left=0.0)
        _, second_um, _ = lsim(lti([20 * w**2], [1, 2 * zeta * w, w**2]), late_V, run.t_s)
        both.append(replace(run, x_um=(1 - share) * run.x_um + share * second_um))
    found = fit_modes(VIEW, both)
    assert found is not None
    assert found.modes[0] == pytest.approx((1 - share, 160.0, 0.02), rel=0.05)
    assert found.modes[1] == pytest.approx((share, 490.0, zeta), rel=0.1)


def test_no_mode_is_adopted_where_there_is_none():
    runs = [triangle_run(f, None, i) for i, f in enumerate((3.0, 5.0, 7.0, 11.0))]
    assert fit_modes(VIEW, runs) is None


def test_slow_records_have_no_mode():
    run = triangle_run(3.0, (160.0, 0.02), 0)
    slow = AxisRun(run.t_s[::50], run.u_V[::50], run.x_um[::50], slice(None), "x", "slow")
    assert fit_modes(VIEW, [slow, slow]) is None
