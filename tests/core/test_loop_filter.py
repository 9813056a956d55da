"""The sections behind the PID: whole numbers to the bit, scipy's filter in floats, and begun without a bump."""

import ctypes as ct

import numpy as np
import pytest
from compensations import ONE_Q26, any_filter, biquad_of, coefficients_b, loop_sections
from core_bindings import (
    Biquad,
    LoopFilterConfig,
    LoopFilterState,
    LoopSectionState,
    any_i32,
    any_u32,
    saturate,
    whole,
)
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

V = 2**24
HALF = 1 << 25
voltage = whole(-(2**31), 2**31 - 1)
NONE = Biquad()


def step(core, config, state, u):
    value, _ = core.flagged("loop_filter_step_q24", config, state, u)
    return value


def exact(section, memory, x):
    """In whole numbers without bounds: the output, and the memory x', x'', y', y'' with what was rounded off."""
    x1, x2, y1, y2, rest = memory
    coefficients = (*coefficients_b(section), -section.a1_q26, -section.a2_q26)
    y, rest = divmod(sum(c * v for c, v in zip(coefficients, (x, x1, x2, y1, y2), strict=True)) + rest, ONE_Q26)
    y, _ = saturate(y)
    return y, (x, x1, y, y1, rest)


def held(state):
    return (state.x1_q24, state.x2_q24, state.y1_q24, state.y2_q24, state.rest_q50)


any_section_state = st.builds(LoopSectionState, *[any_i32] * 4, any_u32)


@given(any_filter, any_section_state, any_section_state, any_u32, st.lists(voltage, min_size=1, max_size=30))
def test_it_is_its_difference_equation_to_the_bit(core, config, one, other, primed, inputs):
    """From any state, as a recording may hold it, memory included; sections not in use keep theirs."""
    state = LoopFilterState(primed, 0, (LoopSectionState * 2)(one, other))
    memory = [held(one), held(other)]
    for tick, u in enumerate(inputs):
        value = u
        for i in range(2):
            if config.in_use >> i & 1:
                begins = tick == 0 and not primed >> i & 1
                value, memory[i] = exact(config.section[i], (*[value] * 4, HALF) if begins else memory[i], value)
        assert step(core, config, state, u) == value
        assert [held(section) for section in state.section] == memory


@given(loop_sections, st.integers(0, 2**32))
def test_it_is_the_filter_in_floats(core, section, seed):
    """To what rounding leaves: less than an LSB a tick, given back in the next."""
    u = np.round(np.cumsum(np.random.default_rng(seed).uniform(-0.01, 0.01, 300)) * V).astype(int)
    b, a = np.array(coefficients_b(section)) / ONE_Q26, np.array([ONE_Q26, section.a1_q26, section.a2_q26]) / ONE_Q26
    config, state = LoopFilterConfig(1, (Biquad * 2)(section)), LoopFilterState()
    found = [step(core, config, state, int(value)) for value in u]
    wanted = u[0] + lfilter(b, a, u - u[0])
    left = np.abs(lfilter([1.0, -1.0], a, np.r_[1.0, np.zeros(5000)])).sum()
    assert np.abs(found - wanted).max() <= left + 1e-3


@given(voltage)
def test_none_changes_no_bit(core, u):
    config, state = LoopFilterConfig(), LoopFilterState()
    before = bytes(state)
    assert step(core, config, state, u) == u
    assert bytes(state) == before


@given(any_filter, voltage)
def test_the_first_output_is_the_first_input_and_stays(core, config, u):
    """Begun without a bump, whatever the sections: an axis goes on from where its output was."""
    state = LoopFilterState()
    assert {step(core, config, state, u) for _ in range(200)} == {u}


@given(any_filter, any_filter, voltage)
def test_an_exchange_at_rest_leaves_the_output(core, before, after, u):
    state = LoopFilterState()
    step(core, before, state, u)
    core.loop_filter_exchange(before, after, state)
    assert state.primed == before.in_use & after.in_use
    assert step(core, after, state, u) == u


@given(st.lists(st.one_of(loop_sections, st.just(NONE)), min_size=2, max_size=2))
def test_those_that_are_zero_are_not_in_use(core, sections):
    config = LoopFilterConfig(in_use=77)
    assert core.loop_filter_make(config, (Biquad * 2)(*sections))
    wanted = [bytes(section) != bytes(NONE) for section in sections]
    assert config.in_use == wanted[0] + 2 * wanted[1]
    assert [bytes(section) for section in config.section] == [bytes(section) for section in sections]


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize(
    "section",
    [
        Biquad(ONE_Q26, 1),
        Biquad(ONE_Q26 // 2),
        Biquad(b1=5),
        Biquad(a2=1),
        biquad_of((1.0, 0, 0), (0.0, 1.0)),
        Biquad(16 * ONE_Q26, -15 * ONE_Q26),
    ],
)
def test_what_is_unstable_too_large_or_has_another_gain_is_refused(core, section, place):
    pair = (Biquad * 2)(Biquad(ONE_Q26), Biquad(ONE_Q26))
    pair[place] = section
    assert not core.loop_filter_make(LoopFilterConfig(), pair)


def test_the_structs_have_no_padding():
    assert (ct.sizeof(LoopFilterConfig), ct.sizeof(LoopFilterState)) == (44, 48)
