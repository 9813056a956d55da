"""The stage's chain undone, as a whole: its parts have their own tests."""

from compensations import Operator, V, any_compensation, memory_of
from core_bindings import INT32_MAX, whole
from hypothesis import given
from hypothesis import strategies as st


@given(any_compensation, st.lists(st.tuples(whole(-2 * V, 10 * V), st.integers(1, 300)), max_size=6))
def test_asked_for_where_it_stands_it_stays_there(core, compensation, stays):
    """Whatever it followed for how long, crept positions included: a path that begins there begins without a kick."""
    state = memory_of(core, compensation)
    for u_q24, ticks in stays:
        for _ in range(ticks):
            core.compensation_follow(compensation, state, u_q24)
    before = state.inverse.x_q44
    here_q16 = core.compensation_here_q16(compensation, state)
    core.flagged("compensation_step_q24", compensation, state, here_q16, INT32_MAX)
    assert abs(state.inverse.x_q44 - before) <= 3 * 2**28 + Operator(compensation.inverse).slopes()


def test_without_a_model_it_stands_at_zero(core):
    assert core.compensation_here_q16(None, None) == 0
