"""A fitted axis in words."""

from __future__ import annotations

import numpy as np
import pytest

from phaselead.identify.words import describe_axis, describe_coupling
from phaselead.model import AdoptedEffect, AxisModel, TimeView
from phaselead.record import from_columns


def said(delay_s):
    view = TimeView(
        gain_um_per_V=20.0, play_r_V=(0.5,), play_w_um_per_V=(3.0,), u_range_V=(0.0, 10.0), rate_Hz=5.0, delay_s=delay_s
    )
    return describe_axis("x", AxisModel(time=view), [])


@pytest.mark.parametrize("delay_s", [0.02, 0.4, 7.0])
def test_gain_and_hysteresis_are_of_the_loop_without_the_delay(delay_s):
    """Of a record every 200 ms the delay may be a second; a loop that is drawn with it is wide, or upside down."""
    assert said(delay_s).split(", no mode")[0] == said(0.0).split(", no mode")[0]
    assert "22.7 um/V, hysteresis 1.3 %" in said(0.0)


@pytest.mark.parametrize(("swing_V", "seen"), [(0.2, True), (9.0, False)])
def test_a_loop_that_no_record_shows_whole_is_said_to_be_seen_in_small_swings(swing_V, seen):
    view = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 10.0), rate_Hz=100.0)
    u_V = 5 + swing_V / 2 * np.sin(np.arange(200) / 10)
    record = from_columns({"t_s": np.arange(200) / 100, "u_V": u_V, "x_um": 20 * u_V})
    line = describe_axis("x", AxisModel(time=view), [record])
    assert "no hysteresis" in line
    assert ("(no record swings by more than 0.2 of the 10 V)" in line) == seen


def test_a_mode_is_told_also_where_the_sensor_counts_backwards():
    view = TimeView(gain_um_per_V=-20.0, u_range_V=(0.0, 10.0), rate_Hz=5000.0)
    mode = AdoptedEffect(name="resonance", params={"f_Hz": 300.0, "zeta": 0.02})
    line = describe_axis("x", AxisModel(time=view, effects=(mode,)), [])
    assert "counts backwards" in line
    assert "a mode at 300 Hz (damping 0.02)" in line


def test_an_axis_sees_all_of_its_own_motion_and_that_is_no_cross_talk():
    """One axis alone moved with itself by 0 %."""
    assert describe_coupling(np.eye(3).tolist()) == "no cross-talk seen"
    assert "y moves with x" in describe_coupling([[1, 0, 0], [0.02, 1, 0], [0, 0, 1]])
