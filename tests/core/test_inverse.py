"""The inverse of the time view: forward of inverse is the identity, to half an LSB of voltage."""

import ctypes as ct

import numpy as np
import pytest
from compensations import UNUSED, Operator, V, inverse_of, inverses, weights
from core_bindings import BENDS_A_TICK, INT32_MAX, Extremes, Inverse, InverseState, any_i32, any_i64, whole
from hypothesis import example, given
from hypothesis import strategies as st

PLAYS = [(round(r * V), round(w * 2**20)) for r, w in ((0.1, 2.0), (0.5, 1.5), (1.2, 2.2), (3.0, 0.6))]
KNOTS = [(round(d * V), round(s * 2**20)) for d, s in ((1, 1.6), (3, 1.5), (6, -2.4))]
ENOUGH = 2 + (32 + 24) // BENDS_A_TICK
"""Ticks for a way over every bend."""
EXISTS, REST, PLAY_ORDER, NEGATIVE, KNOT_ORDER, STEEP, FALLS = range(7)


def settle(core, config, state, target):
    """Steps until there, at most as many as the bends take; voltage, and whether the last one was limited."""
    for _ in range(ENOUGH):
        v, limited = core.flagged("inverse_step_q24", config, state, target, INT32_MAX)
        if not limited:
            break
    return v, limited


def make(core, config, **changed):
    """inverse_make() with the weights that the sums tell, some of them changed; its verdict."""
    given = (ct.c_int32 * 32)(*weights(config))
    for at, weight in changed.items():
        given[int(at[1:])] = weight
    return core.inverse_make(config, given)


def plays(core, config, state):
    return [core.inverse_play_q24(config, state, i) for i in range(config.plays)]


def rested(core, config):
    state = InverseState()
    core.inverse_rest(config, state, 0)
    return state


@given(inverses, st.lists(whole(-200, 1000), min_size=1, max_size=30))
@example(inverse_of(PLAYS, KNOTS), [50, 100, 20, 90, 30, 80, 40, 0])
@example(inverse_of(), [0, 30, 0])
def test_the_position_asked_for_is_the_position_of_the_voltage(core, config, targets_um):
    """Whatever was before: to half an LSB where it can be reached, at the limit where it cannot."""
    before = bytes(config)
    assert (make(core, config), bytes(config)) == (EXISTS, before)
    state, operator = rested(core, config), Operator(config)
    assert state.x_q44 == operator.go(0)
    for target_um in targets_um:
        target = target_um << 44
        v, limited = settle(core, config, state, target)
        x = operator.go(v)
        assert state.x_q44 == x
        assert plays(core, config, state) == operator.plays[: config.plays]
        assert config.u_min_q24 <= v <= config.u_max_q24
        if limited:
            assert x < target if v == config.u_max_q24 else x > target
        else:
            assert abs(x - target) <= operator.slopes() // 2 + 1


@given(inverses, st.lists(whole(-2 * V, 10 * V), min_size=1, max_size=20))
def test_it_is_the_inverse_of_the_voltages_that_were(core, config, voltages):
    """The positions of a voltage history give that history back, where no slope is flatter than an LSB can show."""
    operator = Operator(config)
    state = rested(core, config)
    for v in voltages:
        x = operator.go(v)
        found, _ = settle(core, config, state, x)
        assert abs(found - v) <= 1
        core.inverse_follow(config, state, v)


def test_a_tick_goes_over_so_many_bends_and_the_next_goes_on(core):
    """More plays between here and there than two ticks take: these end at a bend, and say so; the third arrives."""
    n = 2 * BENDS_A_TICK + 1
    config = inverse_of([(i * V // n, 1 << 20) for i in range(1, n + 1)], gain_q20=1 << 20)
    state = rested(core, config)
    steps = [core.flagged("inverse_step_q24", config, state, 60 << 44, INT32_MAX) for _ in range(4)]
    assert [limited for _, limited in steps] == [True, True, False, False]
    assert [v for v, _ in steps[:2]] == [BENDS_A_TICK * V // n, 2 * BENDS_A_TICK * V // n]
    assert abs(steps[2][0] - steps[3][0]) <= 32  # back by what half an LSB of a steeper line was too far
    assert abs(state.x_q44 - (60 << 44)) <= Operator(config).slopes()


def test_a_long_run_does_not_drift(core):
    """A quarter of a million ticks of minor loops: what comes out still is exact, for all sums are of integers."""
    config = inverse_of(PLAYS, KNOTS)
    n = np.arange(250_000)
    um = 60 + 40 * np.sin(n / 700) + 15 * np.sin(n / 91)
    targets = np.round(um * 2**16).astype(np.int64) << 28
    v, state = np.empty(len(n), np.int32), rested(core, config)
    core.h_inverse_many(config, state, targets.ctypes.data, v.ctypes.data, len(n))
    assert abs(state.x_q44 - int(targets[-1])) <= Operator(config).slopes()
    operator = Operator(config)
    for voltage in v[-3000:].tolist():
        operator.go(voltage)
    assert abs(operator.go(int(v[-1])) - int(targets[-1])) <= Operator(config).slopes()


def broken(**fields):
    config = inverse_of(PLAYS, KNOTS)
    for name, value in fields.items():
        if isinstance(value, dict):
            for at, item in value.items():
                getattr(config, name)[at] = item
        else:
            setattr(config, name, value)
    return config


@pytest.mark.parametrize(
    ("config", "verdict"),
    [
        (broken(), EXISTS),
        (broken(rest_fraction_q30=2**30 + 1), REST),
        (broken(rest_fraction_q30=-(2**30) - 1), REST),
        (broken(play={0: (-1,)}), PLAY_ORDER),
        (broken(play={2: (1,)}), PLAY_ORDER),
        (broken(knot_d_q24={1: 0}), KNOT_ORDER),
        (broken(gain_q20=1 << 30), STEEP),
        (inverse_of([(64 << 24, 1 << 20)]), EXISTS),
        (broken(play={3: ((64 << 24) + 1,)}), PLAY_ORDER),
        (broken(gain_q20=(1 << 10) - 1), FALLS),
        (broken(gain_q20=-(10 << 20)), FALLS),
        (broken(knot_s_q20={0: -(10 << 20)}), FALLS),
        (broken(knot_s_q20={2: -(14 << 20)}), FALLS),
        (inverse_of(knots=[(10 * V, -(20 << 20))]), EXISTS),  # it falls beyond what the voltage can be
        (inverse_of(knots=[(-2 * V, -(20 << 20))]), FALLS),
        (inverse_of(gain_q20=-(5 << 20), knots=[(-2 * V, 10 << 20)]), EXISTS),
        (inverse_of(gain_q20=-(5 << 20), knots=[(-2 * V + 1, 10 << 20)]), FALLS),
    ],
)
def test_whether_it_exists(core, config, verdict):
    assert make(core, config) == verdict


def test_weights_may_be_neither_negative_nor_all_too_steep(core):
    assert make(core, broken(), _31=-1) == NEGATIVE
    assert make(core, broken(), _0=1 << 29, _1=1 << 29) == STEEP
    assert make(core, broken(), _0=2**31 - 1, _1=2**31 - 1, _2=2**31 - 1) == STEEP


@given(inverses)
def test_what_it_can_reach(core, config):
    """From all that was drawn down to all that was pushed up; what lies between is reached from either."""
    low, high = ct.c_int32(), ct.c_int32()
    core.inverse_reach_q16(config, low, high)
    for start in (config.u_min_q24, config.u_max_q24):
        state = rested(core, config)
        core.inverse_follow(config, state, start)
        for end, target in ((config.u_max_q24, high.value), (config.u_min_q24, low.value)):
            v, _ = settle(core, config, state, target << 28)
            position = state.x_q44
            assert v == end or abs(position - (target << 28)) <= Operator(config).slopes() + (1 << 27)


@given(inverses, st.integers(1 << 16, 1 << 28))
def test_what_other_axes_cause_is_led_by_the_slope_of_a_loop_of_its_size(core, config, share_q28):
    """Of all plays half were taken, which small loops do not move: 4 um by one of 100 um were led by a fifth less."""
    rising = [(play.r_q24, w) for play, w in zip(config.play, weights(config), strict=False)][: config.plays]
    config = inverse_of(rising, gain_q20=config.gain_q20)
    swing_q24 = 12 * V * share_q28 >> 28
    operator = Operator(config)
    operator.go(config.u_min_q24)
    turned = operator.go(config.u_max_q24)
    slope = (turned - operator.go(config.u_max_q24 - swing_q24)) / swing_q24 / 2**20
    assert core.inverse_per_um_q28(config, share_q28) / 2**28 == pytest.approx(min(1 / slope, 8), rel=1e-4, abs=2**-27)


any_memory = st.builds(
    InverseState,
    any_i64,
    any_i32,
    any_i32,
    *[st.one_of(whole(0, 32), whole(0, 2**32 - 1))] * 5,
    st.builds(lambda turns: (ct.c_int32 * 32)(*turns), st.lists(any_i32, min_size=32, max_size=32)),
)


def a_memory(core, config):
    """After turns of several sizes: plays that move, plays that stopped, and knots passed."""
    state = rested(core, config)
    for v in (6.5, 1.0, 5.0, 3.5):
        for _ in range(ENOUGH):
            core.inverse_follow(config, state, round(v * V))
    assert state.turns != 0
    assert 0 < state.moving < config.plays
    assert 0 < state.knots < config.knots
    return state


def bent_turn(state, by):
    nearest = (state.turns & -state.turns).bit_length() - 1
    state.turn_q24[nearest] += by


@pytest.mark.parametrize(
    "bend",
    [
        lambda state: setattr(state, "rises", 2),
        lambda state: setattr(state, "rises", 1 - state.rises),
        lambda state: setattr(state, "moving", 33),
        lambda state: setattr(state, "moving", state.moving + 1),
        lambda state: setattr(state, "v_q24", 11 * V),
        lambda state: setattr(state, "v_q24", -3 * V),
        lambda state: setattr(state, "turns", state.turns | 1),
        lambda state: setattr(state, "turns", state.turns | 1 << 20),
        lambda state: setattr(state, "risen", ~state.risen & 0xFFFF_FFFF),
        lambda state: bent_turn(state, 11 * V),
        lambda state: bent_turn(state, -11 * V),
        lambda state: bent_turn(state, V // 10),
        lambda state: setattr(state, "knots", state.knots + 1),
        lambda state: setattr(state, "knots", state.knots - 1),
        lambda state: setattr(state, "knots", 25),
        lambda state: setattr(state, "slope_q20", state.slope_q20 + 1),
        lambda state: setattr(state, "x_q44", state.x_q44 + 1),
    ],
)
def test_a_memory_that_is_bent_in_one_place_begins_at_rest(core, bend):
    config = inverse_of(PLAYS, KNOTS)
    state = a_memory(core, config)
    whole_one = bytes(state)
    core.inverse_admit(config, state)
    assert bytes(state) == whole_one
    bend(state)
    voltage = min(max(state.v_q24, config.u_min_q24), config.u_max_q24)
    core.inverse_admit(config, state)
    rest = InverseState()
    core.inverse_rest(config, rest, voltage)
    assert bytes(state) == bytes(rest)


@pytest.mark.parametrize("end", [-1, 1])
def test_a_memory_at_the_end_of_the_output_is_kept(core, end):
    """Where it has turned there too."""
    config = inverse_of(PLAYS, KNOTS)
    state = a_memory(core, config)
    for far in (end, -end, end):
        v_q24 = config.u_max_q24 if far > 0 else config.u_min_q24
        for _ in range(ENOUGH):
            core.inverse_follow(config, state, v_q24)
        assert state.v_q24 == v_q24
        whole_one = bytes(state)
        core.inverse_admit(config, state)
        assert bytes(state) == whole_one


@given(inverses, any_memory, st.lists(whole(-(2**59), 2**59), min_size=1, max_size=5))
def test_any_memory_is_made_one_of_the_operator(core, config, state, targets):
    core.inverse_admit(config, state)
    for target in targets:
        v, _ = core.flagged("inverse_step_q24", config, state, target, INT32_MAX)
        assert config.u_min_q24 <= v <= config.u_max_q24
        for play, p in zip(config.play, plays(core, config, state), strict=False):
            assert v - play.r_q24 <= p <= v + play.r_q24


@given(inverses, st.lists(st.tuples(whole(-(2**59), 2**59), whole(0, 3 * V)), max_size=8))
def test_the_memory_is_of_where_the_voltage_was_however_far_the_position(core, config, steps):
    """What may change by so much in a tick has no turn beyond."""
    state, operator = rested(core, config), Operator(config)
    for target, most in steps:
        before = state.v_q24
        v, limited = core.flagged("inverse_step_q24", config, state, target, most)
        assert abs(v - before) <= most
        x_q44 = operator.go(v)
        assert abs(state.x_q44 - x_q44) <= Operator(config).slopes()
        assert limited or abs(x_q44 - target) <= Operator(config).slopes()


def led(core, config, voltages):
    """Memory after these voltages."""
    state = rested(core, config)
    for v in voltages:
        for _ in range(ENOUGH):
            core.inverse_follow(config, state, v)
    return state


def recalled(core, config, before, state):
    found = InverseState()
    core.inverse_recall(config, found, before, state, state.v_q24)
    return found


@given(inverses, st.lists(whole(-2 * V, 10 * V), max_size=12))
def test_what_a_stage_has_been_through_is_recalled(core, config, voltages):
    """A model that is uploaded again goes on where the one before was: position, plays, and all that follows."""
    state = led(core, config, voltages)
    again = recalled(core, config, config, state)
    assert (again.v_q24, again.x_q44) == (state.v_q24, state.x_q44)
    assert plays(core, config, again) == plays(core, config, state)
    for v in (9 * V, 2 * V, 5 * V):
        for _ in range(ENOUGH):
            core.inverse_follow(config, state, v)
            core.inverse_follow(config, again, v)
        assert again.x_q44 == state.x_q44


@given(st.lists(whole(0, 10 * V), min_size=1, max_size=12), whole(1, 4))
def test_another_operator_recalls_what_the_one_before_was_through(core, voltages, every):
    """Exactly where its plays are some of those that were there."""
    fewer = inverse_of(PLAYS[::every], ())
    before = inverse_of(PLAYS, KNOTS)
    own = led(core, fewer, voltages)
    found = recalled(core, fewer, before, led(core, before, voltages))
    assert (found.v_q24, found.x_q44) == (own.v_q24, own.x_q44)
    assert plays(core, fewer, found) == plays(core, fewer, own)


@given(
    inverses, st.lists(whole(-2 * V, 10 * V), max_size=12), st.booleans(), whole(V, 10 * V), st.integers(0, 63),
    st.integers(1, 3),
)  # fmt: skip
def test_the_furthest_turns_are_all_that_is_left_of_what_was_before(core, config, voltages, rises, furthest, share, n):
    """Of a way that ends at the lowest and the highest voltage, as often as it was there, and turns back: exactly."""
    ends = [min([-furthest // 5, *voltages]) - 1, max([furthest, *voltages]) + 1]
    first, last = ends if rises else ends[::-1]
    way = [*voltages, *n * [first, last], last + (first - last) * share // 64]
    extremes, found = Extremes(), InverseState()
    for v in way:
        core.h_extremes_follow(extremes, v)
    assert (extremes.low_q24, extremes.high_q24, extremes.rose_last) == (min(0, *ends), max(0, *ends), rises)
    core.inverse_begin_after(config, found, extremes, way[-1])
    state = led(core, config, way)
    assert (found.v_q24, found.x_q44) == (state.v_q24, state.x_q44)
    assert plays(core, config, found) == plays(core, config, state)


@given(inverses, st.lists(whole(-2 * V, 10 * V), max_size=12))
def test_a_memory_of_the_operator_is_admitted_as_it_is(core, config, voltages):
    state = rested(core, config)
    for v in voltages:
        core.inverse_follow(config, state, v)
    before = bytes(state)
    core.inverse_admit(config, state)
    assert bytes(state) == before


@given(inverses, st.lists(whole(-3 * V, 11 * V), min_size=1, max_size=40))
def test_what_follows_has_the_memory_of_the_plays(core, config, voltages):
    """Minor loops within minor loops; a way over more bends than a tick has time for is gone in several."""
    state, operator = rested(core, config), Operator(config)
    for v in voltages:
        inside = max(config.u_min_q24, min(config.u_max_q24, v))
        for _ in range(ENOUGH):
            core.inverse_follow(config, state, v)
        assert (state.v_q24, state.x_q44) == (inside, operator.go(inside))
        assert plays(core, config, state) == operator.plays[: config.plays]


def test_unused_places_do_nothing(core):
    assert UNUSED == INT32_MAX
    config = inverse_of(gain_q20=4 << 20)
    state = rested(core, config)
    assert core.flagged("inverse_step_q24", config, state, 8 << 44, INT32_MAX) == (2 * V, False)
    assert ct.sizeof(Inverse) == 16 + 4 * (7 + 3 * 33 + 2 * 24)
