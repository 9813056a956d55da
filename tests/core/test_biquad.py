"""Second-order sections against scipy, and what may be one."""

import numpy as np
import pytest
from compensations import ONE_Q26, PASS, biquad_of, sections
from core_bindings import INT64_MAX, INT64_MIN, Biquad, BiquadState, any_i32, any_i64
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

Q40 = 2.0**40


def run(core, section, values_um):
    values = np.round(values_um * Q40).astype(np.int64)
    core.h_biquad_many((Biquad * 1)(section), 1, values.ctypes.data, len(values))
    return values / Q40


@given(sections, st.integers(0, 2**32), st.floats(-300, 300))
def test_it_is_the_difference_equation(core, section, seed, offset_um):
    """To 2.5 LSB a tick times what goes round the loop, from the steady state of the first value."""
    um = offset_um + np.cumsum(np.random.default_rng(seed).uniform(-1, 1, 400))
    b = np.array([section.b0_q26, section.b1_q26, section.b2_q26]) / ONE_Q26
    a = np.array([ONE_Q26, section.a1_q26, section.a2_q26]) / ONE_Q26
    exact = lfilter(b, a, um - um[0])
    gain = np.abs(lfilter([1.0], a, np.r_[1.0, np.zeros(5000)])).sum()
    assert np.abs(run(core, section, um) - um[0] - exact).max() <= (3 * gain + 2 * np.abs(b).sum()) / Q40 + 1e-9


@given(sections, st.floats(-30000, 30000))
def test_a_constant_stays(core, section, um):
    """Static gain 1, exactly: the section is usable only then."""
    assert core.biquad_is_usable(section)
    out = run(core, section, np.full(2000, um))
    assert np.abs(out - out[0]).max() < 1e-6


def test_one_passes_everything_on(core):
    um = np.random.default_rng(1).uniform(-300, 300, 100)
    assert np.array_equal(run(core, PASS, um), np.round(um * Q40) / Q40)


@pytest.mark.parametrize(
    "section",
    [
        Biquad(),
        Biquad(ONE_Q26, 1),
        biquad_of((1.0, 0, 0), (0.0, 1.0)),  # a2 = 1
        Biquad(ONE_Q26, 0, 0, 2 * ONE_Q26, 0),
        biquad_of((0, 0, 0), (-1.0, 0.0)),  # a pole at 1
        biquad_of((2.0, 0, 0), (1.0, 0.0)),  # a pole at -1
    ],
)
def test_what_is_unstable_or_has_another_gain_is_not_usable(core, section):
    assert not core.biquad_is_usable(section)


@given(st.builds(Biquad, *[any_i32] * 5))
def test_usable_is_stable(core, section):
    a = [ONE_Q26, section.a1_q26, section.a2_q26]
    stable = bool((np.abs(np.roots(a)) < 1 - 1e-9).all())
    gain = ONE_Q26 + section.a1_q26 + section.a2_q26 == section.b0_q26 + section.b1_q26 + section.b2_q26
    assert not core.biquad_is_usable(section) or (gain and (np.abs(np.roots(a)) < 1 + 1e-9).all())
    assert core.biquad_is_usable(section) or not (stable and gain)


@given(st.builds(Biquad, *[any_i32] * 5), st.builds(BiquadState, *[any_i64] * 4), any_i64)
def test_any_state_and_input_stay_within_the_limit(core, section, state, x):
    y, _ = core.flagged("biquad_step_q40", section, state, x)
    assert abs(y) < 2**55
    assert (state.y1_q40, abs(state.x1_q40) < 2**55) == (y, True)


@pytest.mark.parametrize("x", [INT64_MIN, INT64_MAX, 2**55])
def test_saturation_is_told(core, x):
    assert core.flagged("biquad_step_q40", PASS, BiquadState(), x)[1]
