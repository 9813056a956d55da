"""What records can show of a catalogue: no frequency beyond the sampling, no parameter that changes nothing."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.gap.testable import HIGHEST_OF_RATE, shown_by
from phaselead.model import AdoptedEffect, AxisModel, TimeView, catalogue

VIEW = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 8.0), rate_Hz=5000.0)
EVERY = list(catalogue().values())


def shown(rate_Hz, modes=()):
    found = [AdoptedEffect(name="resonance", params={"c": c, "f_Hz": 300.0, "zeta": 0.02}) for c in modes]
    effects, beyond_sampling = shown_by(EVERY, AxisModel(time=VIEW, effects=tuple(found)), 1 / rate_Hz)
    return {one.name: {p.name: p for p in one.parameters} for one in effects}, beyond_sampling


@given(st.floats(0.1, 1e5))
def test_no_response_is_looked_for_where_the_sampling_shows_nothing(rate_Hz):
    effects, beyond_sampling = shown(rate_Hz)
    assert not set(effects) & set(beyond_sampling)
    assert set(effects) | set(beyond_sampling) == set(catalogue())
    for name, parameters in effects.items():
        if catalogue()[name].kind != "disturbance":
            assert all(
                p.low < p.high <= HIGHEST_OF_RATE * rate_Hz * (1 + 1e-12) for p in parameters.values() if p.unit == "Hz"
            )


def test_records_too_slow_for_a_mode_say_so():
    assert shown(20.0)[1] == {"resonance": "needs records of more than 22 rows per second"}
    assert not shown(25.0)[1]


@pytest.mark.parametrize(("modes", "asked"), [((), False), ((1.0,), False), ((0.9, 0.1), True)])
def test_how_much_other_modes_feel_is_asked_where_there_are_others(modes, asked):
    assert ("others" in shown(5000.0, modes)[0]["load_change"]) == asked
