"""Which records are in another unit: a thousand times is, what a mode, a delay or a saturated drive does is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.record.units import factors_moved, in_another_unit, unit_remedy

STEP_S = 2e-4
T_S = STEP_S * np.arange(5000)


def steady(f_Hz: float, answer: complex, gain: float = 8.0) -> tuple[np.ndarray, np.ndarray]:
    """Voltage and settled position of a sine."""
    turn = np.exp(2j * np.pi * f_Hz * T_S)
    return 4 + 3 * turn.imag, gain * (4 + 3 * (answer * turn).imag)


def mode(f_Hz: float, f0_Hz: float, zeta: float, delay_s: float) -> complex:
    r = f_Hz / f0_Hz
    return complex(np.exp(-2j * np.pi * f_Hz * delay_s) / (1 - r**2 + 2j * zeta * r))


def apart(pairs) -> bool:
    found = factors_moved(pairs, [STEP_S] * len(pairs))
    return any(in_another_unit(one / other) for one in found.values() for other in found.values())


@given(
    st.lists(st.floats(2.0, 2400.0), min_size=2, max_size=6, unique=True),
    st.floats(50.0, 1000.0),
    st.floats(0.005, 0.5),
)
def test_sines_through_a_mode_are_in_one_unit(frequencies_Hz, f0_Hz, zeta):
    assert not apart([steady(f_Hz, mode(f_Hz, f0_Hz, zeta, 0.0)) for f_Hz in frequencies_Hz])


@pytest.mark.parametrize("frequencies_Hz", [(5, 20, 110, 800), (5, 120, 1500), (5, 1500, 2400), (150, 500), (2, 17.5)])
@pytest.mark.parametrize("delay_s", [0.0, 3e-4])
def test_sines_of_an_identification_are_in_one_unit(frequencies_Hz, delay_s):
    """A delay turns what is far behind a mode round once more."""
    assert not apart([steady(f_Hz, mode(f_Hz, 100.0, 0.02, delay_s)) for f_Hz in frequencies_Hz])


@given(st.floats(-2.4, 2.4))
def test_what_a_stage_can_do_is_no_unit(decades):
    assert not in_another_unit(10**decades)


@pytest.mark.parametrize("prefix", [1e-6, 1e-3, 1e3, 1e6])
@given(st.floats(-0.45, 0.45), st.floats(2.0, 20.0))
def test_a_prefix_is_seen_whatever_the_stage_does_beside_it(prefix, decades, f_Hz):
    factor = prefix * 10**decades
    u_V, x_um = steady(f_Hz, 1.0)
    found = factors_moved([(u_V, x_um), (u_V, factor * x_um)], [STEP_S] * 2)
    assert in_another_unit(found[1] / found[0])
    assert found[1] / found[0] == pytest.approx(factor)


@pytest.mark.parametrize(
    ("factor", "position", "voltage"),
    [(1e-3, "x_um=3*1000 ", "u_V=2*0.001,"), (2e-6, "x_um=3*1e+06 ", "u_V=2*1e-06,"),
     (700.0, "x_um=3*0.001 ", "u_V=2*1000,")],
)  # fmt: skip
def test_the_remedy_undoes_the_factor(factor, position, voltage):
    assert position in unit_remedy(factor, of_all=True)
    assert voltage in unit_remedy(factor, of_all=True)
    assert "--map" not in unit_remedy(factor, of_all=False)  # it would be for the others too


def test_records_that_stand_still_or_follow_nothing_tell_nothing():
    rng = np.random.default_rng(0)
    still, noise = np.full(5000, 3.0), rng.normal(size=5000)
    u_V, _ = steady(5.0, 1.0)
    assert factors_moved([(still, noise), (u_V, noise)], [STEP_S] * 2) == {}
    assert factors_moved([], []) == {}


@given(st.floats(-0.45, 0.45), st.floats(2.0, 20.0), st.floats(11.0, 200.0))
def test_what_moves_a_thousand_times_as_far_is_told_at_any_speed(decades, f_Hz, times):
    u_V, x_um = steady(f_Hz, 1.0)
    quick_V, quick_um = steady(min(times * f_Hz, 2000.0), 1.0, 8.0 * 1e3 * 10**decades)
    found = factors_moved([(u_V, x_um), (quick_V, quick_um)], [STEP_S] * 2)
    assert in_another_unit(found[1] / found[0])


def test_creep_beside_a_fast_drive_is_no_unit():
    """Of a quick sweep next to nothing is slow; where the stage creeps, its slow motion is hundreds of times that."""
    slow, quick = steady(2.0, 1.0), steady(400.0, 1.0)
    creeps_um = np.linspace(0.0, 30.0, len(T_S))
    expected_um, position_um = quick[1] + 0.001 * creeps_um, quick[1] + creeps_um
    assert not apart([(slow[1], slow[1]), (expected_um, position_um)])
    assert apart([(slow[1], slow[1]), (expected_um, 1000 * expected_um)])
