"""What the time view can express moves into it and answers as before."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import LINEAR, MODE, PIEZO, axis, rich, run

from phaselead.model.axis import AdoptedEffect, TimeView
from phaselead.model.chain import simulate
from phaselead.model.inverse import compensation, in_time_view
from phaselead.model.operator import plays_after

HYSTERESIS = AdoptedEffect(name="hysteresis", params={"width": 0.12, "reach": 0.4, "slope": 1.0, "rest_fraction": 0.4})
BEND = AdoptedEffect(name="asymmetric_hysteresis", params={"bend": 0.03})


@pytest.mark.parametrize("view", [LINEAR, PIEZO], ids=["linear", "piezo"])
@pytest.mark.parametrize(
    ("adopted", "within_um"),
    [
        (HYSTERESIS, 1e-9),
        (BEND, 0.004 * 0.03 * 100),
        (AdoptedEffect(name="delay", params={"delay_s": 0.001}), 1e-9),  # whole rows
        (AdoptedEffect(name="gain_change", params={"gain": 0.05}), 1e-9),
        (AdoptedEffect(name="offset", params={"offset_um": 3.0}), 1e-9),
    ],
    ids=lambda value: value.name if isinstance(value, AdoptedEffect) else "",
)
def test_folded_answers_as_before(view, adopted, within_um):
    model = axis(view.model_copy(update={"delay_s": 0.0}), MODE, adopted)
    one = in_time_view(model)
    assert [e.name for e in one.effects] == ["resonance"]
    u = np.clip(rich(), 0, 8.9)  # within the range: outside, straight pieces go on straight
    assert np.abs(run(one, u) - run(model, u)).max() < within_um * 4  # the mode overshoots
    assert TimeView.model_validate(one.time.model_dump()) == one.time


def test_all_of_them_fold_together():
    model = axis(LINEAR, HYSTERESIS, BEND, AdoptedEffect(name="gain_change", params={"gain": 0.05}))
    one = in_time_view(model)
    assert one.effects == ()
    u = np.clip(rich(), 0, 8.9)
    assert np.abs(run(one, u) - run(model, u)).max() < 0.03


def test_what_it_cannot_express_of_an_effect_is_dropped_and_other_effects_stay():
    skewed = AdoptedEffect(name="asymmetric_hysteresis", params={"bend": 0.03, "skew": 0.01})
    creep = AdoptedEffect(name="creep", params={"gamma": 0.01})
    one = in_time_view(axis(PIEZO, skewed, creep))
    assert one == in_time_view(axis(PIEZO, BEND, creep))
    assert one.effects == (creep,)


@pytest.mark.parametrize("u_range_V", [(-1.0, 9.0), (3.0, 8.0), (-10.0, 10.0)])
@pytest.mark.parametrize(
    "uneven",
    [{"play_tilt": 0.3}, {"play_tilt": -0.3}, {"play_taper": 0.4}, {"field_bend": 0.08}, {"field_bend": -0.15}],
)
def test_an_uneven_view_becomes_even_plays_and_a_curve(uneven, u_range_V):
    """Also where the range does not hold 0 V, at which the stage rests: less is left of a full loop, with its level,
    than by dropping what is uneven."""
    view = PIEZO.model_copy(update={**uneven, "u_range_V": u_range_V})
    one, dropped = in_time_view(axis(view)).time, PIEZO.model_copy(update={"u_range_V": u_range_V})
    assert one.is_even
    low, high = u_range_V
    way = np.linspace(0, high, 200), np.linspace(high, low, 200), np.linspace(low, high, 200)
    t, u = np.arange(600) * 0.01, np.concatenate(way)
    x, made, even = (simulate(axis(v), t, u)[200:] for v in (view, one, dropped))
    assert np.sqrt(np.mean((x - made) ** 2)) < 0.5 * np.sqrt(np.mean((x - even) ** 2))
    assert abs(np.mean(x - made)) < 0.01 * np.ptp(x)


def test_several_curves_need_no_more_dead_zones_than_one():
    """A bent field and an asymmetric loop had 31 together; the device holds 24."""
    bent = PIEZO.model_copy(update={"field_bend": 0.08, "delay_s": 0.0})
    one = compensation(axis(bent, BEND)).view
    assert one.field_bend == 0
    assert len(one.deadzone_d_V) == len(compensation(axis(bent)).view.deadzone_d_V)
    low, high = bent.u_range_V
    up = np.linspace(low, high, 400)
    x, y = (simulate(model, np.arange(400) * 0.01, up, start=plays_after(bent, low)) for model in
            (axis(one), axis(bent, BEND)))  # fmt: skip
    rising = up > low + 2 * max(bent.play_r_V)  # all plays move
    assert np.ptp((x - y)[rising]) < 0.01 * np.ptp(y)
