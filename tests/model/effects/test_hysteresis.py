"""Plays that nothing moves take travel off and open no loop."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import PIEZO, axis

from phaselead.model.axis import AdoptedEffect
from phaselead.model.chain import simulate
from phaselead.model.effects import effect
from phaselead.model.inverse import in_time_view

VIEW = PIEZO.model_copy(update={"delay_s": 0.0})
U_V = VIEW.u_range_V[1] * (1 - np.abs(1 - np.arange(801) / 200 % 2))


def answer(**params):
    given = {"width": 0.1, "reach": 0.4, **params}
    return simulate(axis(VIEW), np.arange(len(U_V)) / 1000, U_V, extra=[(effect("hysteresis"), given)])


@pytest.mark.parametrize("pinned", [0.3, 1.0])
def test_pinned_plays_make_a_line_flatter(pinned):
    lost = answer(pinned=pinned) - answer()
    line = np.polyfit(U_V, lost, 1)
    assert np.ptp(lost - np.polyval(line, U_V)) < 1e-9
    low, high = VIEW.u_range_V
    bare = simulate(axis(VIEW), np.array([0.0, 0.001]), np.array([low, high]))
    assert line[0] * (high - low) == pytest.approx(-pinned * 0.1 * np.ptp(bare), rel=0.2)


def test_a_device_has_them_in_its_gain():
    adopted = AdoptedEffect(name="hysteresis", params={"width": 0.1, "reach": 0.4, "rest_fraction": 0.4, "pinned": 0.5})
    t = np.arange(len(U_V)) / 1000
    whole = simulate(in_time_view(axis(VIEW, adopted)), t, U_V)
    assert np.allclose(whole, simulate(axis(VIEW, adopted), t, U_V), atol=1e-6)
