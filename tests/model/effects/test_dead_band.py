"""A dead band in volts, and a structure that is not equally stiff everywhere."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import LINEAR, MODE, axis, harmonics, rich, run, sine
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.model.effects import catalogue, effect

laws = settings(max_examples=25, deadline=None)


@laws
@given(width_V=st.floats(0.001, 0.5), swing=st.floats(1.0, 8.0))
def test_the_dead_band_has_one_size_at_every_level(width_V, swing):
    u = 4 + sine(swing, 5.0, 2) - swing / 2
    u -= u[0] - 4
    behind = (run(axis(LINEAR), u) - run(axis(LINEAR), u, "dead_band", width_V=width_V)) / 10
    rising, falling = np.argmax(u) - 1, len(u) // 2 + np.argmin(u[len(u) // 2 :]) - 1
    assert behind[rising] == pytest.approx(width_V / 2, abs=1e-9)
    assert behind[np.argmin(u) - 1] == pytest.approx(-width_V / 2, abs=1e-9) or u[falling] == u.min()
    assert np.abs(behind).max() <= width_V / 2 + 1e-9


@laws
@given(st.floats(0.0, 0.5), st.floats(1e-3, 1e3))
def test_volts_or_millivolts_are_the_same_dead_band(width_V, scale):
    scaled = axis(LINEAR.model_copy(update={"gain_um_per_V": 10 / scale, "u_range_V": (0.0, 10 * scale)}))
    x = run(axis(LINEAR), rich(400), "dead_band", width_V=width_V)
    assert np.allclose(run(scaled, rich(400) * scale, "dead_band", width_V=width_V * scale), x, atol=1e-7)


def test_drives_inside_the_dead_band_do_not_move():
    u = 0.04 * np.sin(np.linspace(0, 20, 400))
    assert not run(axis(LINEAR), u, "dead_band", width_V=0.1).any()


@pytest.mark.parametrize(("name", "power", "tone"), [("square", 2, 1), ("cube", 3, 2)])
def test_harmonics_of_the_stiffness_grow_with_their_power(name, power, tone):
    found = []
    for swing in (2.0, 4.0):
        u = sine(swing, 20.0, 40) - swing / 2
        x = run(axis(LINEAR, MODE), u, "stiffness_nonlinearity", **{name: 0.02})[-1000:]
        found.append(harmonics(x, 20.0, 3)[tone])
    assert found[1] / found[0] == pytest.approx(2.0**power, rel=0.03)


@laws
@given(square=st.floats(-0.1, 0.1), cube=st.floats(-0.1, 0.1))
def test_it_bends_the_position_modes_included(square, cube):
    model, u = axis(LINEAR, MODE), rich(800)
    z = run(model, u) / 100
    bent = run(model, u, "stiffness_nonlinearity", square=square, cube=cube)
    assert np.allclose(bent, 100 * (z + square * z**2 + cube * z**3), atol=1e-9)


def test_what_stands_for_an_effect_on_one_axis_is_in_the_catalogue():
    stand_ins = {e.name: e.alone_as for e in catalogue().values() if e.alone_as is not None}
    assert stand_ins == {
        "crossover_distortion": "backlash",
        "dead_band": "backlash",
        "stiffness_nonlinearity": "sensor_nonlinearity",
    }
    assert all(name in catalogue() for name in stand_ins.values())


@laws
@given(width_V=st.floats(0.001, 0.4))
def test_one_axis_without_memory_cannot_tell_a_dead_band_from_backlash(width_V):
    u = rich(500)
    dead, slack = (
        run(axis(LINEAR), u, "dead_band", width_V=width_V),
        run(axis(LINEAR), u, "backlash", width=width_V / 10),
    )
    assert np.allclose(dead, slack, atol=1e-9)
    assert effect("dead_band").alone_as == "backlash"
