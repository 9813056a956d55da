"""What becomes of an effect when only a moving base is there to tell it from."""

from __future__ import annotations

from phaselead.model.effects import effect


def test_a_moving_base_takes_over_what_only_references_tell():
    whole = effect("sensor_nonlinearity")
    alone = whole.for_refitted_base()
    assert {p.name for p in whole.parameters} - {p.name for p in alone.parameters} == {"linear"}
    assert alone.complete({"quadratic": 0.1}) == whole.complete({"quadratic": 0.1})
    assert {p.name for p in effect("rate_dependence").for_refitted_base().parameters} == {
        "growth", "onset_per_s", "reach"
    }  # fmt: skip
