"""The paper's table view: its numbers, its traps, and its edges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.errors import BadInput
from phaselead.model.table import XU_LI_2010, TableView

from stages import table_views  # isort: skip


def test_the_swing_is_peak_to_peak() -> None:
    """Only then is 4.7 % of the range at 5 V the reported 5.31 um, and the travel at 10 V 250 um."""
    range_5V = XU_LI_2010.gain(5.0) * 5
    assert range_5V == pytest.approx(112.65, abs=0.01)
    assert 5.31 / range_5V == pytest.approx(0.047, abs=5e-4)
    assert XU_LI_2010.range_um[1] == pytest.approx(247.4, abs=0.1)


def test_phase_and_offset_by_hand() -> None:
    """um = 5, f = 5: each term of eqs. 7 and 8 written out."""
    assert XU_LI_2010.phase_deg(5, 5) == pytest.approx(
        1.9238 + 0.7477 * 5 + 0.0456 * 5 + 0.0047 * 25 - 0.0466 * 25 + 0.0003 * 25
    )
    assert XU_LI_2010.x0(5, 5) == pytest.approx(
        -1.7893 + 1.1365 * 5 + 0.3635 * 5 - 0.0463 * 25 - 0.0140 * 25 - 0.0150 * 25
    )
    assert XU_LI_2010.x0(2, 20) == pytest.approx(
        -1.7893 + 1.1365 * 2 + 0.3635 * 20 - 0.0463 * 40 - 0.0140 * 4 - 0.0150 * 400
    )


def test_response_lags_by_the_phase_and_swings_by_the_gain() -> None:
    f, swing = 5.0, 5.0
    t = np.arange(20000) / 20000 / f
    x = XU_LI_2010.response(t, swing, f)
    assert np.ptp(x) == pytest.approx(XU_LI_2010.gain(swing) * swing, rel=1e-6)
    assert t[np.argmin(x)] * f * 360 == pytest.approx(XU_LI_2010.phase_deg(swing, f), abs=0.02)
    assert x.min() == pytest.approx(XU_LI_2010.x0(swing, f), abs=1e-4)


@settings(max_examples=100, deadline=None)
@given(view=table_views(), share=st.floats(0, 1))
def test_swing_for_range_is_the_inverse(view: TableView, share: float) -> None:
    low, high = view.range_um
    wanted = low + share * (high - low)
    swing = view.swing_for_range(wanted)
    assert view.swing_V[0] <= swing <= view.swing_V[1]
    assert view.gain(swing) * swing == pytest.approx(wanted, rel=1e-9)


def test_arrays_broadcast() -> None:
    swing, f = np.meshgrid([0.5, 5, 10], [1, 20])
    assert XU_LI_2010.phase_deg(swing, f).shape == (2, 3)
    assert XU_LI_2010.gain([1, 2]).shape == (2,)


@pytest.mark.parametrize(
    ("ask", "told"),
    [
        (lambda view: view.gain(10.1), r"swing 10\.1 V .*rectangle \(0\.5\.\.10 V\)"),
        (lambda view: view.gain([1, 0.4]), r"swing 0\.4 V"),
        (lambda view: view.gain(float("nan")), r"swing nan V"),
        (lambda view: view.phase_deg(5, 21), r"frequency 21 Hz .*\(1\.\.20 Hz\)"),
        (lambda view: view.x0(5, 0.5), r"frequency 0\.5 Hz"),
        (lambda view: view.response([0.0], 5, 30), r"frequency 30 Hz"),
        (lambda view: view.response([0.0], 11, 5), r"swing 11 V"),
        (lambda view: view.swing_for_range(300), r"300 um .*\(8\.105\.\.247\.4 um\)"),
        (lambda view: view.swing_for_range(5), r"5 um .*\(8\.105\.\.247\.4 um\)"),
        (lambda view: view.swing_for_range(float("nan")), r"nan um"),
    ],
)
def test_refuses_outside_the_rectangle(ask: object, told: str) -> None:
    with pytest.raises(BadInput, match=told):
        ask(XU_LI_2010)  # type: ignore[operator]


def test_extrapolates_only_when_told() -> None:
    assert XU_LI_2010.gain(12, extrapolate=True) == pytest.approx(15.2536 + 1.9619 * 12 - 0.1013 * 144)
    assert XU_LI_2010.response([0.0], 12, 30, extrapolate=True).shape == (1,)


def test_monotone_between_the_corners_too() -> None:
    """K(um) um may rise at both ends and fall between them."""
    with pytest.raises(ValueError, match=r"does not rise with um at 5 V"):
        TableView(swing_V=(1, 9), f_Hz=(1, 2), a_um_per_V=(24.0, -5.0, 1 / 3), b_deg=(0,) * 6, c_um=(0,) * 6)
    TableView(swing_V=(1, 9), f_Hz=(1, 2), a_um_per_V=(26.0, -5.0, 1 / 3), b_deg=(0,) * 6, c_um=(0,) * 6)
