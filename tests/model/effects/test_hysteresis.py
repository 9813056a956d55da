"""Travel that goes with a loop beside its plays opens no loop: it changes the slope."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import PIEZO, axis

from phaselead.model.axis import AdoptedEffect
from phaselead.model.chain import simulate
from phaselead.model.effects import effect
from phaselead.model.inverse import in_time_view
from phaselead.model.operator import range_um

VIEW = PIEZO.model_copy(update={"delay_s": 0.0})
U_V = VIEW.u_range_V[1] * (1 - np.abs(1 - np.arange(801) / 200 % 2))


def answer(**params):
    given = {"width": 0.1, "reach": 0.4, **params}
    return simulate(axis(VIEW), np.arange(len(U_V)) / 1000, U_V, extra=[(effect("hysteresis"), given)])


@pytest.mark.parametrize("lost", [0.03, 0.1, -0.07])
@pytest.mark.parametrize("rest", [-1.0, -0.4, 0.0, 0.7])
def test_what_goes_with_the_loop_makes_a_line_flatter(lost, rest):
    change = answer(lost=lost, rest_fraction=rest) - answer(rest_fraction=rest)
    line = np.polyfit(U_V, change, 1)
    assert np.ptp(change - np.polyval(line, U_V)) < 1e-9
    low, high = VIEW.u_range_V
    assert line[0] * (high - low) == pytest.approx(-lost * range_um(axis(VIEW)), rel=1e-6)


@pytest.mark.parametrize("rest", [-1.0, -0.4, 0.4])
def test_a_device_has_it_in_its_gain(rest):
    view = VIEW.model_copy(update={"rest_fraction": rest})
    params = {"width": 0.1, "reach": 0.4, "rest_fraction": rest, "lost": 0.05}
    adopted = AdoptedEffect(name="hysteresis", params=params)
    t = np.arange(len(U_V)) / 1000
    whole = simulate(in_time_view(axis(view, adopted)), t, U_V)
    assert np.allclose(whole, simulate(axis(view, adopted), t, U_V), atol=1e-6)
