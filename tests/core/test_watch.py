"""What makes an axis under feedback unbelievable, and what must not."""

import ctypes as ct

import pytest
from core_bindings import WatchConfig, WatchState, WatchTick
from hypothesis import given
from hypothesis import strategies as st

FINE, RAIL, JUMPED, FROZEN, ERROR, LIMITED = range(6)
UM, V = 1 << 16, 1 << 24
MID, MARGIN, JUMP = 30_000, 64, 16_384
CONFIG = WatchConfig(error_limit_q16=10 * UM, error_ticks=20, u_range_q24=12 * V)
NOISE = (0, 1)


class Watch:
    def __init__(self, core, config=CONFIG):
        self.core, self.config, self.state, self.found = core, config, WatchState(), []

    def tick(self, code=None, *, limited=False, u_q24=0, error_q16=0):
        """With codes that change by one of themselves."""
        code = MID + NOISE[len(self.found) % 2] if code is None else code
        self.found.append(self.core.watch_step(self.config, self.state, WatchTick(code, limited, u_q24, error_q16)))
        return self.found[-1]


@pytest.mark.parametrize("code", [0, 5, MARGIN - 1, 65535, 65530, 65535 - MARGIN + 1])
def test_three_samples_in_a_row_within_a_margin_of_either_rail(core, code):
    watch = Watch(core)
    assert [watch.tick(code), watch.tick(code), watch.tick(), watch.tick(code), watch.tick(code)] == [FINE] * 5
    assert watch.tick(code) == RAIL


@pytest.mark.parametrize("code", [MARGIN, 65535 - MARGIN])
def test_outside_the_margin_is_no_rail(core, code):
    watch = Watch(core)
    assert {watch.tick(code) for _ in range(50)} == {FINE}


def test_three_jumps_close_together(core):
    watch = Watch(core)
    assert watch.tick(MID) == FINE
    assert watch.tick(MID + JUMP) == FINE
    assert watch.tick(MID) == FINE
    assert watch.tick(MID - JUMP) == JUMPED


@given(apart=st.integers(51, 200))
def test_single_spikes_that_go_one_way_are_none(core, apart):
    watch = Watch(core)
    for step in range(5):
        for _ in range(apart):
            watch.tick(20_000 + (JUMP if step % 2 else 0) + len(watch.found) % 2)
    assert set(watch.found) == {FINE}


@pytest.mark.parametrize(("apart", "found"), [(50, JUMPED), (51, FINE)])
def test_jumps_belong_together_up_to_fifty_ticks_apart(core, apart, found):
    watch = Watch(core)
    for jump in range(3):
        watch.tick(20_000 + (JUMP + 1 if jump % 2 else 0))
        for _ in range(apart - 1):
            watch.tick(20_000 + (JUMP + 1 if jump % 2 else 0) + len(watch.found) % 2)
    assert watch.tick(20_000 + JUMP + 1) == found


@given(step=st.integers(-JUMP + 2, JUMP - 2))
def test_fast_motion_is_no_jump(core, step):
    watch = Watch(core)
    for i in range(100):
        watch.tick(MID + (step if i % 2 else 0))
    assert JUMPED not in watch.found


def test_the_first_code_is_no_jump_from_anything(core):
    watch = Watch(core)
    assert {watch.tick(MID) for _ in range(5)} == {FINE}


def test_a_frozen_code_while_the_output_moves_on(core):
    watch = Watch(core)
    found = [watch.tick(MID, u_q24=i * V // 100) for i in range(200)]
    assert found.index(FROZEN) in (99, 100, 101)


@pytest.mark.parametrize(("more", "found"), [(0, FINE), (1, FROZEN), (-1, FINE)])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_frozen_code_counts_where_the_output_moved_by_more_than_a_sixteenth_of_its_range(core, sign, more, found):
    watch = Watch(core)
    watch.tick(MID)
    assert {watch.tick(MID, u_q24=sign * (12 * V // 16 + more)) for _ in range(120)} == {FINE, found}


def test_a_code_that_stands_still_with_its_output_is_not_frozen(core):
    """A sensor with few bits, or without noise, at a hold."""
    watch = Watch(core)
    assert {watch.tick(MID, u_q24=12 * V // 16) for _ in range(1000)} == {FINE}


def test_a_code_that_changes_now_and_then_is_not_frozen(core):
    watch = Watch(core)
    for i in range(3000):
        watch.tick(MID + i // 90, u_q24=i * V // 300)
    assert set(watch.found) == {FINE}


@pytest.mark.parametrize("sign", [1, -1])
def test_an_error_beyond_its_limit_for_its_time(core, sign):
    watch = Watch(core)
    over = sign * (10 * UM + 1)
    assert {watch.tick(error_q16=over) for _ in range(19)} == {FINE}
    assert watch.tick() == FINE  # once within: from the beginning
    assert {watch.tick(error_q16=over) for _ in range(19)} == {FINE}
    assert watch.tick(error_q16=over) == ERROR
    assert watch.tick(error_q16=sign * 10 * UM) == FINE


def test_the_largest_error_is_one_too(core):
    watch = Watch(core, WatchConfig(2**31 - 1, 1, V))
    assert watch.tick(error_q16=-(2**31)) == ERROR


def test_an_output_that_is_cut_for_half_a_second(core):
    watch = Watch(core)
    for i in range(2499):
        watch.tick(limited=True)
        assert watch.found[-1] == FINE, i
    assert watch.tick(limited=True) == LIMITED
    assert watch.tick() == FINE
    assert watch.tick(limited=True) == FINE


def test_counts_do_not_wrap(core):
    watch = Watch(core)
    watch.tick()
    for name in ("rail_ticks", "error_ticks", "limited_ticks", "same_ticks", "calm_ticks", "jumps"):
        setattr(watch.state, name, 2**32 - 1)
    watch.state.code = 0
    assert watch.tick(0, limited=True, error_q16=20 * UM) == RAIL
    assert watch.state.rail_ticks == watch.state.error_ticks == watch.state.limited_ticks == 2**32 - 1
    assert ct.sizeof(WatchState) == 44


@given(low=st.integers(0, 65535), high=st.integers(0, 65535), codes=st.lists(st.integers(0, 65535), max_size=40))
def test_a_range_is_left_with_the_third_code_in_a_row_outside(core, low, high, codes):
    state, outside = WatchState(), 0
    for code in codes:
        outside = outside + 1 if not low <= code <= high else 0
        assert core.watch_range(state, code, low, high) == (outside < 3)
