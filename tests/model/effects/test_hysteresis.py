"""Walls that nothing moves take travel off and open no loop."""

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


@pytest.mark.parametrize("pinned", [0.3, 1.0])
@pytest.mark.parametrize("rest", [-1.0, -0.4, 0.0, 0.7])
def test_pinned_walls_make_a_line_flatter(pinned, rest):
    lost = answer(pinned=pinned, rest_fraction=rest) - answer(rest_fraction=rest)
    line = np.polyfit(U_V, lost, 1)
    assert np.ptp(lost - np.polyval(line, U_V)) < 1e-9
    low, high = VIEW.u_range_V
    assert line[0] * (high - low) == pytest.approx(-pinned * 0.1 * range_um(axis(VIEW)), rel=1e-6)


@pytest.mark.parametrize("rest", [-1.0, -0.4, 0.4])
def test_a_device_has_them_in_its_gain(rest):
    view = VIEW.model_copy(update={"rest_fraction": rest})
    params = {"width": 0.1, "reach": 0.4, "rest_fraction": rest, "pinned": 0.5}
    adopted = AdoptedEffect(name="hysteresis", params=params)
    t = np.arange(len(U_V)) / 1000
    whole = simulate(in_time_view(axis(view, adopted)), t, U_V)
    assert np.allclose(whole, simulate(axis(view, adopted), t, U_V), atol=1e-6)
