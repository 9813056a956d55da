"""Tuning with the stage file of another stage."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import phaselead as pl
from phaselead.control.feedback_loop import HOLD_S, plant_response
from phaselead.control.tuning import course
from phaselead.control.tuning.plant import rings_elsewhere
from phaselead.control.tuning.response import Distortion, Measured
from phaselead.model import AxisModel, SmallSignal
from phaselead.sim import built_in

F_Hz = np.arange(2.0, 1000.0, 5.0)


def measured(f_Hz: float, zeta: float = 0.02) -> Measured:
    """A stage with its mode there."""
    gain = 20 * plant_response(SmallSignal((20.0, 20.0), ((1.0, f_Hz, zeta),), (), HOLD_S + 1e-4), F_Hz)
    rng = np.random.default_rng(1)
    gain = gain * (1 + 0.01 * (rng.normal(size=len(F_Hz)) + 1j * rng.normal(size=len(F_Hz))))
    none, sure = Distortion(F_Hz, np.zeros(len(F_Hz))), np.ones(len(F_Hz))
    return Measured(F_Hz, gain, sure, 0.01 * sure, 0.0, none, none, none, none)


@pytest.mark.usefixtures("short_search")
def test_a_stage_file_of_another_stage_is_doubted() -> None:
    """The loop is made for what was measured all the same."""
    words = (
        r"x: the stage rings at 8\d(\.\d)? Hz, and its stage file has modes at 200 .*: is it the file of this stage\?"
    )
    with pl.connect("sim://x500") as dev, pytest.warns(UserWarning, match=words):
        dev.tune("x", model=built_in("xyz250"))


@pytest.mark.parametrize(("f_Hz", "told"), [(90.0, True), (145.0, False), (200.0, False), (400.0, True)])
def test_a_mode_far_from_those_of_the_stage_file_is_told(f_Hz: float, told: bool) -> None:
    """A load may move it: then the response is fitted all the same."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        fitted = course._fitted("x", measured(f_Hz), built_in("xyz250"))
    assert fitted.plant.modes[0][1] == pytest.approx(f_Hz, rel=0.01)
    assert any("is it the file of this stage?" in str(one.message) for one in said) == told


def test_a_stage_that_hardly_resonates_tells_nothing() -> None:
    one = measured(90.0, zeta=0.4)
    known = SmallSignal((20.0, 20.0), ((1.0, 200.0, 0.02),), (), HOLD_S)
    assert rings_elsewhere(one.f_Hz, one.gain, known) is None
    assert rings_elsewhere(one.f_Hz, measured(90.0).gain, known) is not None


def test_without_a_model_of_the_axis_nothing_is_said() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        course._fitted("x", measured(90.0), pl.Stage(name="bare", axes={"x": AxisModel()}))
