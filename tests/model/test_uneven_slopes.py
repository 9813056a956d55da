"""Feedback is designed for the steepest place of an uneven view, not of the even plays that the device gets."""

from __future__ import annotations

import pytest

from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.linearised import small_signal


@pytest.mark.parametrize(
    ("uneven", "steepest"),
    [({"play_tilt": 0.4}, 10 + 6 * 1.4), ({"play_tilt": -0.7}, 10 + 6 * 1.7), ({"field_bend": 0.15}, 16 * 1.3)],
)
def test_the_highest_slope_is_where_all_plays_move_at_the_steep_end(uneven, steepest):
    view = TimeView(
        gain_um_per_V=10.0,
        play_r_V=(0.3, 0.8, 1.6),
        play_w_um_per_V=(2.0, 2.0, 2.0),
        u_range_V=(0.0, 10.0),
        rate_Hz=1e3,
    )
    low, high = small_signal(AxisModel(time=view.model_copy(update=uneven))).gain_um_per_V
    assert (
        0.98 * steepest <= high < 1.1 * steepest
    )  # the even plays may be steeper still, where they make up for a curve
    assert low <= 10.0
