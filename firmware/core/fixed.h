/* The one place where numbers are multiplied, rounded, shifted and saturated.
 *
 * Formats, by suffix:  _q16 micrometres x 2^16   _q24 control volts x 2^24   _qN value x 2^N
 *                      _turn32 uint32, 2^32 is one turn (a lead is the same thing signed)   _turn64 likewise in 64 bits
 * Every product is 64 bits wide, rounded to nearest (ties up: floor(x + 1/2)), then saturated. All of these functions
 * are exact: tests/core/test_fixed.py compares them with unbounded integers.
 */
#ifndef PHASELEAD_CORE_FIXED_H
#define PHASELEAD_CORE_FIXED_H

#include <stdbool.h>
#include <stdint.h>

#define TICK_RATE_HZ 5000

/* C leaves these two to the compiler. A compiler that does something unusual is refused here. */
_Static_assert(((int64_t)-3 >> 1) == -2, "right shift of a signed value must be arithmetic");
_Static_assert((int32_t)0x80000000u == INT32_MIN, "unsigned to signed must wrap");

/* floor(value / 2^bits). 0 <= bits <= 63. */
static inline int64_t floor_shift_i64(int64_t value, unsigned bits)
{
    return value >> bits;
}

/* floor(value / 2^bits). 0 <= bits <= 31. */
static inline int32_t floor_shift_i32(int32_t value, unsigned bits)
{
    return value >> bits;
}

/* value / 2^bits, rounded to nearest. 1 <= bits <= 63. Cannot overflow: the half is added after the shift. */
static inline int64_t round_shift_i64(int64_t value, unsigned bits)
{
    return floor_shift_i64(value, bits) + (floor_shift_i64(value, bits - 1) & 1);
}

/* value / 2^bits, rounded to nearest. 1 <= bits <= 31. */
static inline int32_t round_shift_i32(int32_t value, unsigned bits)
{
    return floor_shift_i32(value, bits) + (floor_shift_i32(value, bits - 1) & 1);
}

static inline int32_t clamp_i32(int32_t value, int32_t low, int32_t high)
{
    return value < low ? low : value > high ? high : value;
}

static inline int16_t sat_i16(int32_t value)
{
    return (int16_t)clamp_i32(value, INT16_MIN, INT16_MAX);
}

/* Limits to [low, high] and sets *saturated when it had to. Never clears it: one flag serves a whole block. */
static inline int64_t sat_between_i64(int64_t value, int64_t low, int64_t high, bool *saturated)
{
    if (value > high) {
        *saturated = true;
        return high;
    }
    if (value < low) {
        *saturated = true;
        return low;
    }
    return value;
}

/* -2^bits <= value < 2^bits: one comparison, which is all that a limit costs where it does not act. 0 <= bits <= 62. */
static inline bool is_below_power_i64(int64_t value, unsigned bits)
{
    return ((uint64_t)value + ((uint64_t)1 << bits)) >> (bits + 1) == 0;
}

/* Limits to +-2^bits. 0 <= bits <= 62. */
static inline int64_t sat_power_i64(int64_t value, unsigned bits, bool *saturated)
{
    if (!is_below_power_i64(value, bits))
        value = sat_between_i64(value, -((int64_t)1 << bits), (int64_t)1 << bits, saturated);
    return value;
}

/* Limits to -2^bits .. 2^bits - 1. 0 <= bits <= 62. */
static inline int64_t sat_below_power_i64(int64_t value, unsigned bits, bool *saturated)
{
    if (!is_below_power_i64(value, bits)) {
        *saturated = true;
        value = value < 0 ? -((int64_t)1 << bits) : ((int64_t)1 << bits) - 1;
    }
    return value;
}

/* One comparison where nothing saturates: that is what a tick does all the time. */
static inline int32_t sat_i32(int64_t value, bool *saturated)
{
    const int32_t low = (int32_t)(uint32_t)(uint64_t)value;
    if (low == value)
        return low;
    *saturated = true;
    return value < 0 ? INT32_MIN : INT32_MAX;
}

static inline int32_t sat_add_i32(int32_t a, int32_t b, bool *saturated)
{
    return sat_i32((int64_t)a + b, saturated);
}

static inline int32_t sat_sub_i32(int32_t a, int32_t b, bool *saturated)
{
    return sat_i32((int64_t)a - b, saturated);
}

/* a + b and a - b, saturated to int32, where the caller need not know whether they were. */
static inline int32_t add_i32(int32_t a, int32_t b)
{
    bool saturated = false;
    return sat_add_i32(a, b, &saturated);
}

static inline int32_t sub_i32(int32_t a, int32_t b)
{
    bool saturated = false;
    return sat_sub_i32(a, b, &saturated);
}

static inline int64_t sat_add_i64(int64_t a, int64_t b, bool *saturated)
{
    if (b > 0 && a > INT64_MAX - b) {
        *saturated = true;
        return INT64_MAX;
    }
    if (b < 0 && a < INT64_MIN - b) {
        *saturated = true;
        return INT64_MIN;
    }
    return a + b;
}

static inline uint64_t magnitude_i64(int64_t value)
{
    return value < 0 ? 0 - (uint64_t)value : (uint64_t)value;
}

/* a x b / 2^bits, rounded to nearest. 1 <= bits <= 62. */
static inline int64_t mul_shift_wide_i32(int32_t a, int32_t b, unsigned bits)
{
    return floor_shift_i64((int64_t)a * b + ((int64_t)1 << (bits - 1)), bits); /* at most 2^62 + 2^61 */
}

/* a x b / 2^bits, rounded to nearest, saturated to int32. */
static inline int32_t mul_shift_i32(int32_t a, int32_t b, unsigned bits, bool *saturated)
{
    return sat_i32(mul_shift_wide_i32(a, b, bits), saturated);
}

/* High half of a product, rounded down, and rounded to nearest. */
static inline int32_t mul_high_i32(int32_t a, int32_t b)
{
    return (int32_t)floor_shift_i64((int64_t)a * b, 32);
}

static inline int32_t mul_high_round_i32(int32_t a, int32_t b)
{
    return (int32_t)mul_shift_wide_i32(a, b, 32);
}

/* a + (b - a) x fraction, rounded to nearest. 0 <= fraction_q30 <= 2^30. */
static inline int32_t lerp_i32(int32_t a, int32_t b, uint32_t fraction_q30)
{
    return (int32_t)(a + round_shift_i64(((int64_t)b - a) * (int64_t)fraction_q30, 30));
}

/* A value as high x 2^32 + low with both halves signed, so that their products are too. |value| < 2^62. */
static inline int32_t signed_low_i64(int64_t value)
{
    return (int32_t)(uint32_t)value;
}

static inline int32_t signed_high_i64(int64_t value)
{
    return (int32_t)round_shift_i64(value, 32);
}

/* sum + a x b / 2^64, the product rounded to nearest, for |a| < 2^62 and 0 <= b <= 2^62. The lowest 32 bits of the
 * product cannot reach the half that rounds; with it, the product of the low halves is positive: its high half is all
 * of it. */
static inline int64_t add_mul_shift64_i64(int64_t sum, int64_t a, int64_t b)
{
    int32_t a_low = signed_low_i64(a), a_high = signed_high_i64(a);
    int32_t b_low = signed_low_i64(b), b_high = signed_high_i64(b);
    int64_t middle = (int64_t)(((uint64_t)((int64_t)a_low * b_low) + ((uint64_t)1 << 63)) >> 32);
    middle += (int64_t)a_high * b_low;
    middle += (int64_t)a_low * b_high;
    sum += floor_shift_i64(middle, 32);
    return sum + (int64_t)a_high * b_high;
}

/* High and low half of the 128-bit product. No __int128: a 32-bit target has none. */
static inline uint64_t mul_wide_u64(uint64_t a, uint64_t b, uint64_t *low)
{
    uint64_t a0 = (uint32_t)a, a1 = a >> 32, b0 = (uint32_t)b, b1 = b >> 32;
    uint64_t p00 = a0 * b0, p01 = a0 * b1, p10 = a1 * b0;
    uint64_t middle = (p00 >> 32) + (uint32_t)p01 + (uint32_t)p10;
    *low = (middle << 32) | (uint32_t)p00;
    return a1 * b1 + (p01 >> 32) + (p10 >> 32) + (middle >> 32);
}

/* a x b / 2^bits, rounded to nearest, saturated to int64. 1 <= bits <= 63. Not for the tick. */
static inline int64_t mul_shift_i64(int64_t a, int64_t b, unsigned bits, bool *saturated)
{
    bool negative = (a < 0) != (b < 0);
    uint64_t low, high = mul_wide_u64(magnitude_i64(a), magnitude_i64(b), &low);
    uint64_t half = ((uint64_t)1 << (bits - 1)) - (negative ? 1 : 0); /* -floor(x + 1/2) of a negative x is a ceiling */
    low += half;
    high += low < half;
    uint64_t limit = (uint64_t)INT64_MAX + (negative ? 1 : 0);
    uint64_t size = (high << (64 - bits)) | (low >> bits);
    if (high >> bits != 0 || size > limit) {
        *saturated = true;
        return negative ? INT64_MIN : INT64_MAX;
    }
    return negative ? (int64_t)(0 - size) : (int64_t)size;
}

/* a / b, rounded towards 0, without a division, so that every value takes the same time. a < 2^32 b. */
uint32_t ratio_u32(uint64_t a, uint32_t b);

/* Leading zeros of a word, value != 0, in plain C: for compilers without a builtin. */
static inline unsigned leading_zeros_portable_u32(uint32_t value)
{
    unsigned zeros = 0;
    for (unsigned step = 0; step < 5; step++) {
        unsigned half = 16u >> step;
        if (value >> (32 - half) == 0) {
            zeros += half;
            value <<= half;
        }
    }
    return zeros;
}

/* Leading and trailing zeros of a word, value != 0. */
static inline unsigned leading_zeros_u32(uint32_t value)
{
#if defined(__GNUC__)
    return (unsigned)__builtin_clz(value);
#else
    return leading_zeros_portable_u32(value);
#endif
}

static inline unsigned trailing_zeros_u32(uint32_t value)
{
    return 31u - leading_zeros_u32(value & (0u - value));
}

#endif
