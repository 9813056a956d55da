"""What the time view can express moves into it and answers as before."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import LINEAR, MODE, PIEZO, axis, rich, run

from phaselead.model.axis import AdoptedEffect, TimeView
from phaselead.model.inverse import folded

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
    one = folded(model)
    assert [e.name for e in one.effects] == ["resonance"]
    u = np.clip(rich(), 0, 8.9)  # within the range: outside, straight pieces go on straight
    assert np.abs(run(one, u) - run(model, u)).max() < within_um * 4  # the mode overshoots
    assert TimeView.model_validate(one.time.model_dump()) == one.time


def test_all_of_them_fold_together():
    model = axis(LINEAR, HYSTERESIS, BEND, AdoptedEffect(name="gain_change", params={"gain": 0.05}))
    one = folded(model)
    assert one.effects == ()
    u = np.clip(rich(), 0, 8.9)
    assert np.abs(run(one, u) - run(model, u)).max() < 0.03


def test_what_it_cannot_express_stays():
    skewed = AdoptedEffect(name="asymmetric_hysteresis", params={"bend": 0.03, "skew": 0.01})
    creep = AdoptedEffect(name="creep", params={"gamma": 0.01})
    assert folded(axis(PIEZO, skewed, creep)) == axis(PIEZO, skewed, creep)
