"""A stage file says of which voltages it was fitted: of those whose rows were left out it knows nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.identify import fit
from phaselead.identify.operator.regressors import fitted_span_V, rows_to_fit
from phaselead.identify.runs import AxisRun
from phaselead.model import simulate
from phaselead.model.axis import AxisModel, TimeView
from phaselead.record import AxisRecord, Recording

RATE_HZ = 500.0
STAGE = AxisModel(
    time=TimeView(
        gain_um_per_V=9.0, u_range_V=(-5.0, 10.0), rate_Hz=RATE_HZ, rest_fraction=1.0,
        play_r_V=(0.2, 0.8, 2.0, 3.5), play_w_um_per_V=(0.8, 0.8, 0.6, 0.6),
    )
)  # fmt: skip


def recorded(u_V, seed):
    t_s = np.arange(len(u_V)) / RATE_HZ
    x_um = simulate(STAGE, t_s, u_V) + 0.004 * np.random.default_rng(seed).normal(size=len(u_V))
    return Recording(t_s, {"x": AxisRecord(u_V, x_um)}, source=f"{seed}.csv")


def waves():
    """A sweep from 0 to 9 V, and another that begins with a step below 0 V, for a moment only."""
    t_s = np.arange(6000) / RATE_HZ
    swept = 4.5 * (1 - np.cos(2 * np.pi * 0.5 * t_s)) * (1 - 0.7 * t_s / t_s[-1])
    stepped = 4.5 * (1 - np.cos(2 * np.pi * 0.25 * t_s))
    stepped[0:60] = np.linspace(-1.5, 0.0, 60)
    return swept, stepped


def test_voltages_right_after_a_jump_alone_were_not_fitted():
    """A step below 0 V was over before its rows counted: the slope there came to a fifth, and micrometres were off."""
    records = [recorded(u_V, seed) for seed, u_V in enumerate(waves())]
    view = fit(records)[0].axes["x"].time
    assert view.u_range_V[0] == 0.0
    below = np.concatenate([np.linspace(0, 9, 500), np.linspace(9, -4, 700)])
    t_s = np.arange(len(below)) / RATE_HZ
    off_um = simulate(AxisModel(time=view), t_s, below) - simulate(STAGE, t_s, below)
    assert np.abs(off_um - off_um[0]).max() < 0.1


@given(st.integers(1, 5000), st.integers(1, 60), st.floats(-3.0, 12.0))
@settings(max_examples=60, deadline=None)
def test_a_moment_after_a_jump_is_not_fitted_but_where_the_ringing_is(at, length, to_V):
    u_V = waves()[0].copy()
    whole = u_V.min(), u_V.max()
    u_V[at : at + length] = to_V
    run = AxisRun(np.arange(6000) / RATE_HZ, u_V, 9.0 * u_V, slice(None), "x", "a.csv")
    assert fitted_span_V([run], 0.1) == (u_V.min(), u_V.max())
    low_V, high_V = fitted_span_V([run])
    if abs(to_V - u_V[at - 1]) > 3.0:
        assert (low_V, high_V) == pytest.approx(whole, abs=1.5)
        assert whole[0] <= low_V < high_V <= whole[1]


def test_where_a_stage_stays_after_a_jump_is_fitted():
    u_V = np.concatenate([waves()[0], np.full(6000, 12.0)])
    run = AxisRun(np.arange(12000) / RATE_HZ, u_V, 9.0 * u_V, slice(None), "x", "a.csv")
    assert fitted_span_V([run]) == (0.0, 12.0)


@pytest.mark.parametrize("most_rows", [1200, 15_000])
def test_quick_jumps_leave_rows_to_fit_however_they_are_thinned(most_rows):
    """Of a sawtooth whose period is that of the thinning every row that was kept lay right behind a jump."""
    u_V = np.tile(np.linspace(0.0, 9.0, 250), 1200)
    run = AxisRun(np.arange(len(u_V)) / 5000, u_V, 9.0 * u_V, slice(None), "x", "a.csv")
    fitted = rows_to_fit(run, most_rows, 0, 1)
    assert len(fitted.rows) > most_rows // 2
    assert np.isfinite(fitted.weight) or np.ptp(run.x_um[fitted.rows]) == 0
