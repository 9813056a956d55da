"""fixed.h against unbounded integers: exact on every input."""

import ctypes as ct

from core_bindings import (
    INT32_MAX,
    INT32_MIN,
    INT64_MAX,
    INT64_MIN,
    any_i32,
    any_i64,
    any_u64,
    round_half_up,
    saturate,
    whole,
)
from hypothesis import example, given
from hypothesis import strategies as st

bits = st.integers(1, 63)


@given(any_i64, st.integers(0, 63))
@example(INT64_MIN, 63)
@example(-1, 63)
def test_floor_shift_is_floor(core, value, shift):
    assert core.h_floor_shift_i64(value, shift) == value // 2**shift


@given(any_i64, bits)
@example(INT64_MAX, 1)
@example(INT64_MIN, 63)
@example(-1, 1)
@example(-3, 1)
def test_round_shift_is_nearest_with_ties_up(core, value, shift):
    assert core.h_round_shift_i64(value, shift) == round_half_up(value, shift)


@given(any_i64)
@example(INT32_MAX + 1)
@example(INT32_MIN - 1)
@example(INT32_MAX)
@example(INT32_MIN)
def test_sat_i32(core, value):
    assert core.flagged("h_sat_i32", value) == saturate(value)


@given(any_i64, any_i64, any_i64)
def test_sat_between(core, value, one, other):
    low, high = sorted((one, other))
    assert core.flagged("h_sat_between_i64", value, low, high) == saturate(value, low, high)


@given(any_i64, st.integers(32, 61), st.integers(-2, 2))
def test_sat_power_is_sat_between(core, value, power, beside):
    for one in (value, 2**power + beside, -(2**power) + beside):
        assert core.flagged("h_sat_power_i64", one, power) == saturate(one, -(2**power), 2**power)
        assert core.flagged("h_sat_below_power_i64", one, power) == saturate(one, -(2**power), 2**power - 1)


@given(any_i32, any_i32)
@example(INT32_MAX, 1)
@example(INT32_MIN, -1)
@example(0, INT32_MIN)
@example(-1, INT32_MIN)
def test_sums_of_32_bits(core, a, b):
    assert core.flagged("h_sat_add_i32", a, b) == saturate(a + b)
    assert core.flagged("h_sat_sub_i32", a, b) == saturate(a - b)


@given(whole(1, 2**32 - 1), st.integers(0, 31))
def test_zeros_at_the_ends_of_a_word(core, value, shift):
    """By the compiler's own count and by the portable one, at every length."""
    for word in (value >> shift or 1, 1 << shift, value << shift & 0xFFFF_FFFF or 1):
        assert core.h_leading_zeros_u32(word) == 32 - word.bit_length()
        assert core.h_leading_zeros_portable_u32(word) == core.h_leading_zeros_u32(word)
        assert core.h_trailing_zeros_u32(word) == (word & -word).bit_length() - 1


@given(any_i32, any_i32)
@example(INT32_MIN, INT32_MIN)
@example(INT32_MIN, INT32_MAX)
@example(1, -1)
def test_high_halves_of_products(core, a, b):
    assert core.h_mul_high_i32(a, b) == a * b // 2**32
    assert core.h_mul_high_round_i32(a, b) == round_half_up(a * b, 32)


@given(any_i32)
@example(32768)
@example(-32769)
def test_sat_i16(core, value):
    assert core.h_sat_i16(value) == min(max(value, -32768), 32767)


def test_saturation_flag_is_never_cleared(core):
    saturated = ct.c_bool(True)
    core.h_sat_i32(0, ct.byref(saturated))
    core.h_sat_add_i64(1, 1, ct.byref(saturated))
    core.h_mul_shift_i32(1, 1, 1, ct.byref(saturated))
    core.h_mul_shift_i64(1, 1, 1, ct.byref(saturated))
    assert saturated.value


@given(any_i64, any_i64)
@example(INT64_MAX, 1)
@example(INT64_MIN, -1)
@example(INT64_MIN, INT64_MAX)
@example(INT64_MIN, INT64_MIN)
def test_sat_add(core, a, b):
    assert core.flagged("h_sat_add_i64", a, b) == saturate(a + b, INT64_MIN, INT64_MAX)


@given(any_i32, any_i32, st.integers(1, 62))
@example(INT32_MIN, INT32_MIN, 1)
@example(INT32_MIN, INT32_MAX, 31)
@example(INT32_MIN, INT32_MIN, 31)
def test_mul_shift_i32(core, a, b, shift):
    assert core.flagged("h_mul_shift_i32", a, b, shift) == saturate(round_half_up(a * b, shift))


@given(any_i32, any_i32)
@example(INT32_MIN, INT32_MIN)
@example(INT32_MAX, INT32_MAX)
def test_sums_stop_at_the_limit(core, a, b):
    assert core.h_add_i32(a, b) == saturate(a + b)[0]
    assert core.h_sub_i32(a, b) == saturate(a - b)[0]


@given(any_i32, st.integers(1, 31))
@example(INT32_MAX, 2)
@example(INT32_MIN, 31)
def test_round_shift_i32(core, value, shift):
    assert core.h_round_shift_i32(value, shift) == round_half_up(value, shift)


@given(whole(-(2**61), 2**61), whole(-(2**62) + 1, 2**62 - 1), whole(0, 2**62))
@example(0, 2**62 - 1, 2**62)
@example(0, -(2**62) + 1, 2**62)
@example(0, -1, 2**31)
@example(0, 2**31, 2**31)
def test_add_mul_shift64(core, total, a, b):
    assert core.h_add_mul_shift64_i64(total, a, b) == total + round_half_up(a * b, 64)


@given(whole(1, 2**32 - 1), whole(0, 2**32 - 1), whole(0, 2**32 - 1))
@example(1, 2**32 - 1, 0)
@example(2**31, 2**32 - 1, 2**31 - 1)
@example(2**32 - 1, 2**32 - 1, 2**32 - 2)
def test_ratio_is_the_whole_part(core, divisor, ratio, rest):
    """Of every dividend that leaves a ratio in 32 bits."""
    dividend = ratio * divisor + rest % divisor
    assert core.h_ratio_u32(dividend, divisor) == ratio


@given(any_u64, any_u64)
@example(2**64 - 1, 2**64 - 1)
def test_mul_wide(core, a, b):
    low = ct.c_uint64()
    high = core.h_mul_wide_u64(a, b, ct.byref(low))
    assert (high << 64) + low.value == a * b


@given(any_i64, any_i64, bits)
@example(INT64_MIN, INT64_MIN, 63)
@example(INT64_MIN, INT64_MAX, 63)
@example(INT64_MIN, 1, 1)
@example(INT64_MIN, 2, 1)
@example(INT64_MIN, -2, 1)
@example(-1, 1, 1)
@example(-3, 1, 1)
@example(-1, 0, 5)
def test_mul_shift_i64(core, a, b, shift):
    expected = saturate(round_half_up(a * b, shift), INT64_MIN, INT64_MAX)
    assert core.flagged("h_mul_shift_i64", a, b, shift) == expected


@given(any_i32, any_i32, whole(0, 2**30))
@example(INT32_MIN, INT32_MAX, 2**30)
@example(INT32_MAX, INT32_MIN, 2**30)
def test_lerp_stays_between(core, a, b, fraction):
    result = core.h_lerp_i32(a, b, fraction)
    assert result == a + round_half_up((b - a) * fraction, 30)
    assert min(a, b) <= result <= max(a, b)


@given(any_i32, any_i32, any_i32)
def test_clamp(core, value, one, other):
    low, high = sorted((one, other))
    assert core.h_clamp_i32(value, low, high) == max(low, min(high, value))
