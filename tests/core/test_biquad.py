"""Second-order sections against scipy, and what may be one."""

import numpy as np
import pytest
from compensations import ONE_Q26, PASS, biquad_of, coefficients_b, sections
from core_bindings import INT32_MIN, Biquad, BiquadState, BiquadValue, any_i32, round_half_up, saturate, whole
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
    """To half an LSB a tick times what goes round the loop, from the steady state of the first value."""
    um = offset_um + np.cumsum(np.random.default_rng(seed).uniform(-1, 1, 400))
    b = np.array([section.b0_q26, section.b1_q26, section.b2_q26]) / ONE_Q26
    a = np.array([ONE_Q26, section.a1_q26, section.a2_q26]) / ONE_Q26
    exact = lfilter(b, a, um - um[0])
    gain = np.abs(lfilter([1.0], a, np.r_[1.0, np.zeros(5000)])).sum()
    assert np.abs(run(core, section, um) - um[0] - exact).max() <= (gain + 2 * np.abs(b).sum()) / Q40 + 1e-9


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


any_value = st.builds(BiquadValue, any_i32, any_i32)
x_q40 = whole(-(2**55), 2**55 - 1)


@given(st.builds(Biquad, *[any_i32] * 5), st.builds(BiquadState, *[any_value] * 4), x_q40)
def test_a_step_is_the_nearest_value_and_within_the_limit(core, section, state, x):
    """Of any coefficients, once any state has been admitted."""
    core.biquad_admit(state)
    before = [value.q40 for value in (state.x1, state.x2, state.y1, state.y2)]
    assert all(-(2**55) <= value < 2**55 for value in before)
    a1, a2 = (v if v == INT32_MIN else -v for v in (section.a1_q26, section.a2_q26))  # what is stable is far from it
    products = zip((*coefficients_b(section), a1, a2), (x, *before), strict=True)
    expected = saturate(round_half_up(sum(c * v for c, v in products), 26), -(2**55), 2**55 - 1)
    assert core.flagged("biquad_step_q40", section, state, x) == expected
    assert [v.q40 for v in (state.x1, state.x2, state.y1, state.y2)] == [x, before[0], expected[0], before[2]]


def test_saturation_is_told(core):
    twice = Biquad(2 * ONE_Q26)
    assert core.flagged("biquad_step_q40", twice, BiquadState(), 2**54) == (2**55 - 1, True)
    assert core.flagged("biquad_step_q40", twice, BiquadState(), -(2**54)) == (-(2**55), False)
