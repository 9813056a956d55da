"""What undoes the mechanics, the mechanics and the converter's hold are together a delay and no more."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.model import AdoptedEffect, AxisModel, compensation
from phaselead.model.axis import Sensor, TimeView
from phaselead.model.level_sections import MOST_LIFT, hold, level
from phaselead.model.sections import TICK_S
from phaselead.record import Samples


def axis(*effects: tuple[str, dict], bandwidth_Hz: float | None = None) -> AxisModel:
    view = TimeView(gain_um_per_V=15.0, u_range_V=(-2.0, 10.0), rate_Hz=5000.0)
    adopted = tuple(AdoptedEffect(name=name, params=params) for name, params in effects)
    return AxisModel(time=view, effects=adopted, sensor=Sensor(bandwidth_Hz=bandwidth_Hz))


def way(model: AxisModel, f_Hz: Samples, mechanics: Samples) -> Samples:
    """Of what is asked for to where it is, seen by the preview early."""
    found = compensation(model)
    undone = found.shape_response(f_Hz) * found.drive.response(f_Hz)
    return np.asarray(hold(f_Hz) * mechanics * undone * np.exp(2j * np.pi * f_Hz * found.preview_s))


def mode(f_Hz: Samples, at_Hz: float, zeta: float) -> Samples:
    s = 1j * f_Hz / at_Hz
    return np.asarray(1 / (1 + 2 * zeta * s + s**2))


@settings(max_examples=30)
@given(st.floats(30, 450), st.floats(0.005, 0.1))
def test_a_mode_and_what_undoes_it_are_a_delay(at_Hz: float, zeta: float) -> None:
    """To 4e-4 at half of the mode and 5e-3 at it; the section for the mode alone leaves three times as much."""
    f_Hz = np.array([0.1, 0.25, 0.5, 1.0]) * at_Hz
    off = np.abs(way(axis(("resonance", {"f_Hz": at_Hz, "zeta": zeta})), f_Hz, mode(f_Hz, at_Hz, zeta)) - 1)
    assert (off < [1e-6, 3e-5, 4e-4, 5e-3]).all()


def test_so_are_a_sensor_and_an_amplifier_with_it() -> None:
    f_Hz = np.array([20.0, 50.0, 100.0])
    effects = (
        ("resonance", {"f_Hz": 200.0, "zeta": 0.02}),
        ("sensor_lowpass", {"tau_s": 8e-5}),
        ("amplifier_lowpass", {"tau_s": 2e-4}),
    )
    both = (1 + 2j * np.pi * f_Hz * 8e-5) * (1 + 2j * np.pi * f_Hz * 2e-4)
    assert np.abs(way(axis(*effects), f_Hz, mode(f_Hz, 200.0, 0.02) / both) - 1).max() < 1.5e-3


def test_a_sensor_of_the_data_sheet_counts_by_its_gain() -> None:
    """Its delay is in the time view, where a fit has put it."""
    f_Hz = np.array([50.0, 100.0])
    known = axis(("resonance", {"f_Hz": 200.0, "zeta": 0.02}), bandwidth_Hz=2000.0)
    turn = 1j * f_Hz / 2000.0
    seen = mode(f_Hz, 200.0, 0.02) / (1 + turn) * np.exp(turn)
    assert np.abs(way(known, f_Hz, seen) - 1).max() < 6e-4
    assert np.abs(way(axis(*((e.name, dict(e.params)) for e in known.effects)), f_Hz, seen) - 1).max() > 1.2e-3


@given(st.floats(-0.05, 5.0), st.floats(-1.0, 200.0))
def test_any_section_is_stable_and_lifts_no_more_than_it_may(fallen: float, late: float) -> None:
    w = 2 * np.pi * 20.0 * TICK_S
    section = level(np.array([np.exp(-fallen * w**2 - 1j * late * w**3)]), 20.0)
    if section is None:
        return
    assert (np.abs(np.roots([1.0, *section.a])) < 1).all()
    assert sum(section.b) == pytest.approx(1 + sum(section.a))
    assert np.abs(section.response(np.linspace(0, 2500, 50))).max() <= 1 + 2 * MOST_LIFT + 1e-9


def test_what_is_level_gets_no_section() -> None:
    assert level(np.ones(1, dtype=complex), 20.0) is None
    assert compensation(axis()).shape == ()


def test_an_axis_without_room_keeps_what_it_has() -> None:
    six = [("resonance", {"f_Hz": 200.0 + 50 * i, "zeta": 0.02}) for i in range(6)]
    assert len(compensation(axis(*six)).shape) == 6
