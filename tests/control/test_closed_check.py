"""A closed loop that could not be measured is no loop with a margin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import phaselead as pl
from phaselead.control.feedback_loop import HOLD_S, pid_response, plant_response
from phaselead.control.tuning import course
from phaselead.control.tuning.closed_check import refuse_closed
from phaselead.control.tuning.plant import FittedPlant
from phaselead.control.tuning.response import Distortion, Measured
from phaselead.control.tuning.result import ClosedLoop
from phaselead.errors import BadInput
from phaselead.model import Gains, SmallSignal
from phaselead.sim import built_in

PLANT = SmallSignal((20.0, 20.0), ((1.0, 200.0, 0.02),), (), HOLD_S + 1e-4)
GAINS = Gains(kp_V_per_um=0.0, ki_V_per_um_s=25.0, kd_V_s_per_um=2.3e-5)
FITTED = FittedPlant(PLANT, 20.0, np.zeros(1))
f_Hz = course.CLOSED.grid.frequencies(course.CLOSED.grid.excited)


def measured(heard: np.ndarray, gain: float = 20.0) -> ClosedLoop:
    """This loop, with coherence at the lines ``heard`` (m,)."""
    row = gain * plant_response(PLANT, f_Hz) * pid_response(GAINS, f_Hz)
    none = Distortion(f_Hz, np.zeros(len(f_Hz)))
    coherence = np.where(heard, 0.99, 0.5)
    return ClosedLoop(Measured(f_Hz, row / (1 + row), coherence, np.full(len(f_Hz), 0.01), 0.0, none, none, none, none))


def at_peak() -> np.ndarray:
    found = np.abs(measured(np.full(len(f_Hz), True)).sensitivity)
    return found >= (1 + found.max()) / 2


def test_a_loop_that_was_measured_passes() -> None:
    assert at_peak().sum() > 3
    for heard in (np.full(len(f_Hz), True), at_peak(), f_Hz < f_Hz[at_peak()].max() + 1):
        refuse_closed("x", measured(heard), FITTED, GAINS, level_V=0.2, usual_V=0.2)


def test_a_peak_that_no_loop_has_is_refused_with_a_level_in_between() -> None:
    """On x500 at 50 mV, a quarter of the usual level, 5 of 154 lines had coherence: a peak of 0.42 was printed, and
    the gains were written."""
    slow = measured(f_Hz < 15)
    assert slow.peak_sensitivity < 1
    words = r"x: the closed loop could not be measured: .* is predicted at .* Hz.* a --level between 50 mV and 200 mV"
    with pytest.raises(BadInput, match=words):
        refuse_closed("x", slow, FITTED, GAINS, level_V=0.05, usual_V=0.2)
    with pytest.raises(BadInput, match="a --level above 200 mV"):
        refuse_closed("x", slow, FITTED, GAINS, level_V=0.2, usual_V=0.2)


def test_a_peak_that_was_not_heard_is_refused_although_another_was() -> None:
    peak = at_peak()
    with pytest.raises(BadInput, match=rf"0 of the {peak.sum()} lines about there have coherence"):
        refuse_closed("x", measured(~peak), FITTED, GAINS, level_V=0.2, usual_V=0.2)
    assert measured(~peak).peak_sensitivity > 1


def test_a_peak_that_was_met_needs_no_more_lines() -> None:
    one = at_peak() & (np.cumsum(at_peak()) == at_peak().sum() // 2)
    refuse_closed("x", measured((f_Hz < 15) | one), FITTED, GAINS, level_V=0.2, usual_V=0.2)


def test_a_peak_below_1_is_refused_although_every_line_was_heard() -> None:
    whole = measured(np.full(len(f_Hz), True)).response
    half = ClosedLoop(replace(whole, gain=np.full(len(f_Hz), 0.5 + 0j)))
    with pytest.raises(BadInput, match=r"at which it is 0\.5 at most"):
        refuse_closed("x", half, FITTED, GAINS, level_V=0.2, usual_V=0.2)


def test_a_peak_above_3_is_refused() -> None:
    with pytest.raises(BadInput, match="the stage is not what was measured in open loop"):
        refuse_closed("x", measured(np.full(len(f_Hz), True), 100.0), FITTED, GAINS, level_V=0.2, usual_V=0.2)


@pytest.mark.usefixtures("short_search")
def test_tune_writes_nothing_where_its_loop_was_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    def deaf(*args, **asked):  # type: ignore[no-untyped-def]
        found = measure(*args, **asked)
        return found if "gains" not in asked else replace(found, coherence=np.where(found.f_Hz < 30, 0.99, 0.5))

    measure = course.measure
    monkeypatch.setattr(course, "measure", deaf)
    with (
        pl.connect("sim://xyz250") as dev,
        pytest.raises(BadInput, match=r"could not be measured.* between 150 mV and 200 mV, the default"),
    ):
        dev.tune("x", model=built_in("xyz250"), level=0.15)
