"""What a section undoes is undone: beside its delay nothing is left of a low-pass or a mode at low frequencies."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import freqz

from phaselead.errors import BadInput
from phaselead.model.sections import COEFFICIENTS, PASS, TICK_S, Section, undo_lowpass, undo_modes


def lowpass(tau_s, f_Hz):
    return 1 / (1 + 2j * np.pi * f_Hz * tau_s)


def mechanics(modes, f_Hz):
    s, rigid = 2j * np.pi * f_Hz, 1 - sum(c for c, _, _ in modes)
    w = [2 * np.pi * f for _, f, _ in modes]
    return rigid + sum(c * v**2 / (s**2 + 2 * z * v * s + v**2) for (c, _, z), v in zip(modes, w, strict=True))


def together(plant, undone, f_Hz):
    """Plant and sections, seen by the delay early."""
    gain = np.prod([section.response(f_Hz) for section in (*undone.sections, PASS)], axis=0)
    return plant * gain * np.exp(2j * np.pi * f_Hz * undone.delay_s)


def stable(section):
    return (np.abs(np.roots([1.0, *section.a])) < 1).all()


@given(st.floats(1e-5, 0.01))
def test_a_lowpass_is_undone(tau_s):
    undone = undo_lowpass(tau_s)
    f_Hz = np.linspace(0.1, min(0.25 / tau_s / 2 / np.pi, 150), 30)
    assert np.abs(together(lowpass(tau_s, f_Hz), undone, f_Hz) - 1).max() < 0.04
    assert all(map(stable, undone.sections))


one_mode = st.tuples(st.floats(0.1, 1.0), st.floats(30, 1000), st.floats(0.005, 0.2)).map(lambda mode: [mode])
two_modes = st.tuples(
    st.floats(0.3, 0.6), st.floats(40, 200), st.floats(0.05, 0.3), st.floats(1.5, 4), st.floats(0.005, 0.1)
).map(lambda v: [(v[0], v[1], v[4]), (v[2], v[1] * v[3], v[4])])


@settings(max_examples=50)
@given(st.one_of(one_mode, two_modes))
def test_modes_are_undone(modes):
    """Up to a third of the first mode to a few per cent; at the mode, where it was 1/(2 zeta), to a factor."""
    undone, first = undo_modes(modes), min(f for _, f, _ in modes)
    f_Hz = np.linspace(0.01 * first, first / 3, 20)
    assert np.abs(together(mechanics(modes, f_Hz), undone, f_Hz) - 1).max() < 0.06
    peak = np.array([first])
    assert 0.3 < np.abs(together(mechanics(modes, peak), undone, peak))[0] < 2.5
    assert len(undone.sections) == len(modes)
    for section in undone.sections:
        assert stable(section)
        assert sum(section.b) == pytest.approx(1 + sum(section.a))


@given(st.floats(30, 750), st.floats(0.005, 0.1))
def test_a_mode_is_undone_flat(f_Hz, zeta):
    """At half of the mode the gain is right to 1 % (two real poles were 2.7 % short)."""
    undone, half = undo_modes([(1.0, f_Hz, zeta)]), np.array([f_Hz / 2])
    assert np.abs(together(mechanics([(1.0, f_Hz, zeta)], half), undone, half))[0] == pytest.approx(1, abs=0.01)


@given(st.floats(0.1, 0.95), st.floats(0.1, 0.95), st.floats(-3, 3), st.floats(-0.9, 0.9))
def test_response_and_delay_are_those_of_the_difference_equation(p, q, b1, b2):
    a = (-(p + q), p * q)
    b = (1 + sum(a) - b1 - b2, b1, b2)
    section = Section(b, a)
    f_Hz = np.array([1e-3, 1.0, 60.0, 900.0])
    _, exact = freqz(b, [1, *a], worN=2 * np.pi * f_Hz * TICK_S)
    assert section.response(f_Hz) == pytest.approx(exact, rel=1e-9)
    assert -np.angle(exact[0]) / (2 * np.pi * f_Hz[0]) == pytest.approx(section.delay_s, rel=1e-3, abs=1e-8)


@pytest.mark.parametrize("modes", [[(1.6, 100.0, 0.01)], [(2.5, 300.0, 0.02)]])
def test_an_unstable_inverse_is_refused_with_its_zero(modes):
    with pytest.raises(BadInput, match=r"zero in the right half-plane at \d"):
        undo_modes(modes)


def test_what_is_too_fast_for_the_tick_is_left_to_the_preview():
    assert undo_lowpass(5e-6).sections == ()
    assert undo_lowpass(5e-6).delay_s == 5e-6
    assert undo_modes([(1.0, 2400.0, 0.02)]).sections == ()
    assert undo_modes([]).sections == ()


@pytest.mark.parametrize("f_Hz", [1.0, 10.0, 100.0, 600.0])
def test_a_mode_is_undone_as_far_as_the_coefficients_of_the_device_reach(f_Hz):
    """Its roll-off is where they end, for a mode far below the tick rate."""
    (section,) = undo_modes([(1.0, f_Hz, 0.001)]).sections
    largest = max(map(abs, section.b))
    assert largest < COEFFICIENTS
    assert largest > 0.99 * COEFFICIENTS or f_Hz > 5
