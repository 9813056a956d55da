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


@pytest.mark.parametrize(("tilt", "fade"), [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.4), (0.2, -0.3)])
def test_plays_of_uneven_weight_become_even_ones_and_a_curve(tilt, fade):
    """Less is left of a full loop than by dropping what their weight depends on."""
    uneven = PIEZO.model_copy(update={"play_tilt": tilt, "play_fade": fade})
    one = in_time_view(axis(uneven)).time
    assert one.density.is_even
    low, high = uneven.u_range_V
    loop = (low + high) / 2 - (high - low) / 2 * np.cos(2 * np.pi * np.arange(800) / 400)
    dropped = PIEZO.model_copy(update={"play_tilt": 0.0, "play_fade": 0.0})
    x, made, even = (
        simulate(axis(view), np.arange(800) * 0.01, loop, start=plays_after(view, high, low))[400:]
        for view in (uneven, one, dropped)
    )
    assert np.std(x - made) < 0.5 * np.std(x - even)


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
