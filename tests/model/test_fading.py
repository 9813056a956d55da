"""Laws of fading plays, against the differential equation in small steps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.model.chain import simulate
from phaselead.model.effects import effect_of_fading
from phaselead.model.fading import REVERSIBLE, fading_lag_um, opening_V, plays_alike, state_after, state_like_plays
from phaselead.model.inverse import in_time_view
from phaselead.model.operator import plays

volts = st.floats(-5, 5)
ways = st.lists(volts, min_size=2, max_size=12).map(np.array)
thresholds = st.floats(0.05, 3.0)
states = st.floats(-1, 1)


def integrated(v, r, z, parts=400):
    """z after the straight ways between the voltages ``v``, by the midpoint rule."""
    for a, b in pairwise(v):
        d, side = abs(b - a) / parts, np.sign(b - a)
        for _ in range(parts):
            middle = z + 0.5 * d * (side - z) / (2 * r)
            z += d * (side - middle) / (2 * r)
    return z


@given(ways, thresholds, states)
def test_the_state_solves_the_equation_of_dahl(v, r, z):
    assert state_after(v, np.array([r]), np.array([z]))[0] == pytest.approx(integrated(v, r, z), abs=5e-3)


@given(ways, thresholds, states)
def test_the_lag_is_that_of_the_state_and_at_most_the_threshold(v, r, z):
    lag = fading_lag_um(v, [r], [2.0], [z])
    each = [-2.0 * r * state_after(v[: i + 1], np.array([r]), np.array([z]))[0] for i in range(len(v))]
    assert lag == pytest.approx(each, abs=1e-9)
    assert np.abs(lag).max() <= 2.0 * r * (1 + 1e-12)


@given(ways, thresholds, states, st.integers(2, 5))
def test_only_turns_count_not_how_often_a_way_is_sampled(v, r, z, parts):
    finer = np.concatenate([*(np.linspace(a, b, parts, endpoint=False) for a, b in pairwise(v)), v[-1:]])
    assert fading_lag_um(finer, [r], [1.0], [z])[::parts] == pytest.approx(fading_lag_um(v, [r], [1.0], [z]), abs=1e-9)


@given(thresholds, st.floats(0.5, 20.0))
def test_a_steady_loop_opens_as_is_said(r, span):
    loop = np.tile([0.0, span / 2, span, span / 2], 400)
    lag = fading_lag_um(loop, [r], [1.0], [0.0])
    assert lag[-1] - lag[-3] == pytest.approx(opening_V(r, span), abs=1e-6 * span)


def test_it_forgets_where_it_turned_and_plays_do_not():
    """A small loop off the middle of a large one is drawn to its middle; that of plays comes back to where it began."""
    small = np.concatenate([np.linspace(0, 5, 50), *[[4.6, 5.0]] * 20])
    lag = fading_lag_um(small, [0.5], [1.0], [0.0])[50::2]
    assert np.all(np.diff(lag) > 0)
    play = plays(small, [0.5], [0.0])[0][50::2, 0]
    assert np.ptp(play) == 0


@given(thresholds, st.floats(0.1, 20.0))
def test_the_plays_alike_have_its_steady_loops(r, span):
    """They move by as much over every span, within half of the slope of one of them."""
    like = plays_alike(r)
    loop = np.tile([0.0, span], 2000)
    moved = span + fading_lag_um(loop, [r], [1.0], [0.0])[-1] - fading_lag_um(loop, [r], [1.0], [0.0])[-2]
    by_plays = REVERSIBLE * span + (1 - REVERSIBLE) * np.mean(np.maximum(span - 2 * like, 0))
    assert by_plays == pytest.approx(moved, abs=0.5 * (1 - REVERSIBLE) / len(like) * span + 1e-9)


@given(st.floats(0.05, 1.5), st.floats(0.5, 5.0))
def test_its_state_is_told_by_plays_that_came_the_same_way(r, to_V):
    """From a loop over a long way it is as good as turned, as they are."""
    known = np.linspace(0.05, 8.0, 60)
    v = np.array([0.0, 60.0, -60.0, -60.0 + 40 * r + to_V])
    at, _ = plays(v, known, np.zeros(60))
    assert state_like_plays(r, known, v[-1] - at[-1]) == pytest.approx(1.0, abs=0.05)
    assert state_like_plays(r, [], []) == 0.0


VIEW = TimeView(
    gain_um_per_V=14.0,
    play_r_V=(0.5, 1.5),
    play_w_um_per_V=(1.0, 2.0),
    rest_fraction=0.6,
    u_range_V=(0.0, 8.0),
    rate_Hz=1e3,
)


def test_the_device_inverts_plays_that_have_the_same_steady_loops():
    """Of any span the way is the same within a tenth of the largest opening; 0 V still rests where it did."""
    bare = AxisModel(time=VIEW)
    e, params = effect_of_fading(np.array([1.0, 0.25]), np.array([3.0, 1.5]), bare)
    axis = bare.model_copy(update={"effects": (AdoptedEffect(name=e.name, params=params),)})
    inverted = in_time_view(axis)
    assert inverted.effects == ()
    assert inverted.time is not None
    t = np.arange(2000) / 1e3
    opening_um = float(opening_V([1.0, 0.25], 8.0) @ [3.0, 1.5])
    for half_V in (0.3, 1.0, 4.0):
        u = 4 - half_V * np.cos(2 * np.pi * 4 * t)
        there, alike = (simulate(one, t, u)[1000:] for one in (axis, inverted))
        assert np.std(there - alike - np.mean(there - alike)) < opening_um / 10
    still = np.zeros(5)
    assert simulate(axis, t[:5], still) == pytest.approx(simulate(bare, t[:5], still))
    assert simulate(inverted, t[:5], still) == pytest.approx(simulate(bare, t[:5], still))
