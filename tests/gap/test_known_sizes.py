"""What no stage is known to have is not named, however well it describes the records; it may still predict."""

from __future__ import annotations

import pytest
from test_gap_laws import answer, names, parts

from phaselead.model import AdoptedEffect, AxisModel, Parameter, TimeView, catalogue
from trials import in_trials

VIEW = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 8.0), rate_Hz=5000.0)
LIMITED = [(e, p) for e in catalogue().values() for p in e.parameters if p.known is not None]


def test_creep_the_curve_of_a_sensor_and_friction_are_limited():
    assert {e.name for e, _ in LIMITED} == {"creep", "rate_dependence", "sensor_nonlinearity"}


@pytest.mark.parametrize(("effect", "parameter"), LIMITED, ids=[f"{e.name}.{p.name}" for e, p in LIMITED])
def test_what_is_known_lies_within_what_may_be_given(effect, parameter):
    low, high = parameter.known
    assert parameter.low <= low < parameter.typical < high <= parameter.high
    asked = next(p for p in effect.as_known().parameters if p.name == parameter.name)
    assert (asked.low, asked.high) == (low, high)
    assert asked.as_known() == asked
    beyond = {parameter.name: parameter.low}
    assert AxisModel(time=VIEW, effects=(AdoptedEffect(name=effect.name, params=beyond),)).effects


def test_a_parameter_of_which_nothing_is_known_keeps_its_bounds():
    free = Parameter("gain", "1", 0.03, -0.9, 2.0)
    assert free.as_known() is free


@pytest.mark.parametrize(("per_decade", "named"), [(0.05, True), *in_trials((-0.08, False))])
def test_a_stage_that_creeps_is_named_and_one_that_creeps_back_is_not(per_decade, named):
    result = answer(parts({"creep": per_decade}, seconds=4.0))
    assert ("creep" in names(result)) == named
    assert not any("creep" in tie for tie in result.ties)
    assert named or "unknown" in result.verdicts
    assert result.gap.after < 0.5 * result.gap.before  # adopted all the same, and not vouched for
    assert [(one.name, one.status) for one in result.adopted if one.name == "creep"] == [
        ("creep", "named" if named else "provisional")
    ]
