"""The compiled sections answer as they were designed to, but for the rounding of their coefficients."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.control.quantised import held_response, shape_response
from phaselead.device import wire
from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.model.sections import COEFFICIENTS
from phaselead.model.stage_file import Stage

F_Hz = np.array([1.0, 5.0, 20.0, 80.0, 150.0, 400.0, 1500.0])


def stage(*effects):
    view = TimeView(gain_um_per_V=15.0, u_range_V=(-2.0, 10.0), rate_Hz=5000.0)
    adopted = tuple(AdoptedEffect(name=name, params=params) for name, params in effects)
    return Stage(name="s", axes={"y": AxisModel(time=view, effects=adopted)})


@settings(max_examples=15)
@given(f_Hz=st.floats(30, 1500), zeta=st.floats(0.005, 0.3), c=st.floats(0.5, 1.1), tau_s=st.floats(1e-5, 5e-3))
def test_rounding_changes_the_response_by_less_than_a_thousandth(f_Hz, zeta, c, tau_s):
    model = stage(("resonance", {"c": c, "f_Hz": f_Hz, "zeta": zeta}), ("sensor_lowpass", {"tau_s": tau_s}))
    response = shape_response(model, "y", F_Hz)
    assert np.abs(response.held / response.designed - 1).max() < 1e-3


def test_it_is_the_devices_code_that_answers():
    """Other coefficients, another response: nothing is taken from the design."""
    half = wire.Biquad(1 << 25, 1 << 25, 0, 0, 0)
    expected = 0.5 + 0.5 * np.exp(-2j * np.pi * F_Hz / 5000)
    assert held_response((half,), F_Hz) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("c", [0.9, 0.97, 0.999, 1.0, 1.05])
def test_any_share_near_one_can_be_held(c):
    """The zeros of the mechanics run off to infinity as one mode takes all of the motion."""
    response = shape_response(stage(("resonance", {"c": c, "f_Hz": 100.0, "zeta": 0.02})), "y", F_Hz)
    assert np.abs(response.held).max() < 0.75 * COEFFICIENTS  # half by the roll-off, the rest by what levels it


def test_an_axis_without_an_inverse_is_refused():
    with pytest.raises(BadInput, match="right half-plane"):
        shape_response(stage(("resonance", {"c": 2.0, "f_Hz": 300.0, "zeta": 0.02})), "y", F_Hz)
