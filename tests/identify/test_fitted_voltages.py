"""A stage file says of which voltages it was fitted: of those whose rows were left out it knows nothing."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.identify import fit
from phaselead.identify.operator.records import span_of
from phaselead.identify.operator.regressors import _after_jump, rows_to_fit
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


@given(st.integers(0, 5000), st.integers(1, 60), st.floats(-3.0, 12.0), st.integers(50, 9000))
@settings(max_examples=60, deadline=None)
def test_the_voltages_of_rows_that_are_left_out_are_not_among_those_of_the_fit(at, length, to_V, most_rows):
    u_V = waves()[0].copy()
    u_V[at : at + length] = to_V
    run = AxisRun(np.arange(6000) / RATE_HZ, u_V, 9.0 * u_V, slice(None), "x", "a.csv")
    counted = u_V[~_after_jump(run)]
    assert span_of([run], 0.0) == (counted.min(), counted.max())
    assert not _after_jump(run)[rows_to_fit(run, most_rows, 0, 1).rows].any()
    assert span_of([run], 0.1) == (u_V.min(), u_V.max())
