/* The one place where numbers are multiplied, rounded, shifted and saturated.
 *
 * Formats, by suffix:  _q16 micrometres x 2^16   _q24 control volts x 2^24   _qN value x 2^N
 *                      _turn32 uint32, 2^32 is one turn (a lead is the same thing signed)   _turn64 likewise in 64 bits
 * Every product is 64 bits wide, rounded to nearest (ties away from minus infinity: floor(x + 1/2)), then saturated.
 * All of these are exact: tests/core/test_fixed.py compares them with unbounded integers over every input.
 */
#ifndef PHASELEAD_CORE_FIXED_H
#define PHASELEAD_CORE_FIXED_H

#include <stdbool.h>
#include <stdint.h>

#define TICK_RATE_HZ 5000

/* C leaves these two to the compiler. Every one we build with does the obvious; one that does not is refused here. */
_Static_assert(((int64_t)-3 >> 1) == -2, "right shift of a signed value must be arithmetic");
_Static_assert((int32_t)0x80000000u == INT32_MIN, "unsigned to signed must wrap");

/* floor(value / 2^bits). 0 <= bits <= 63. */
static inline int64_t floor_shift_i64(int64_t value, unsigned bits)
{
    return value >> bits;
}

/* value / 2^bits, rounded to nearest. 1 <= bits <= 63. Cannot overflow: the half is added after the shift. */
static inline int64_t round_shift_i64(int64_t value, unsigned bits)
{
    return (value >> bits) + ((value >> (bits - 1)) & 1);
}

static inline int32_t floor_shift_i32(int32_t value, unsigned bits)
{
    return value >> bits;
}

/* value / 2^bits, rounded to nearest, 2 <= bits <= 31. */
static inline int32_t round_shift_i32(int32_t value, unsigned bits)
{
    return ((value >> (bits - 1)) + 1) >> 1;
}

/* a x b / 2^bits, rounded to nearest. 1 <= bits <= 62. */
static inline int64_t mul_shift_wide_i32(int32_t a, int32_t b, unsigned bits)
{
    return ((int64_t)a * b + ((int64_t)1 << (bits - 1))) >> bits; /* at most 2^62 + 2^61 */
}

/* High half of a product, rounded down and to nearest. Unsigned shifts: with signed ones GCC 12 sees 64 bits in what
 * follows, and multiplies those. */
static inline int32_t mul_high_i32(int32_t a, int32_t b)
{
    return (int32_t)(uint32_t)((uint64_t)((int64_t)a * b) >> 32);
}

static inline int32_t mul_high_round_i32(int32_t a, int32_t b)
{
    return (int32_t)(uint32_t)((uint64_t)((int64_t)a * b + ((int64_t)1 << 31)) >> 32);
}

static inline int32_t clamp_i32(int32_t value, int32_t low, int32_t high)
{
    return value < low ? low : value > high ? high : value;
}

static inline int16_t sat_i16(int32_t value)
{
#if defined(__ARM_FEATURE_SAT) && defined(__GNUC__)
    return (int16_t)__builtin_arm_ssat(value, 16); /* one instruction, where the compiler makes six of the line below */
#else
    return (int16_t)clamp_i32(value, INT16_MIN, INT16_MAX);
#endif
}

/* a + b and a - b, or the limit of int32 beyond which they are. */
static inline int32_t add_i32(int32_t a, int32_t b)
{
    int32_t sum;
    return __builtin_add_overflow(a, b, &sum) ? (b < 0 ? INT32_MIN : INT32_MAX) : sum;
}

static inline int32_t sub_i32(int32_t a, int32_t b)
{
    int32_t difference;
    return __builtin_sub_overflow(a, b, &difference) ? (b < 0 ? INT32_MAX : INT32_MIN) : difference;
}

/* (a + b) / 2, rounded up. */
static inline int32_t upper_mean_i32(int32_t a, int32_t b)
{
    return (a | b) - floor_shift_i32(a ^ b, 1);
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

/* Limits to +-2^bits, 32 <= bits <= 61: what lies well within is told by its high half. */
static inline int64_t sat_power_i64(int64_t value, unsigned bits, bool *saturated)
{
    uint32_t limit = 1u << (bits - 32);
    if ((uint32_t)floor_shift_i64(value, 32) + limit < 2 * limit)
        return value;
    return sat_between_i64(value, -((int64_t)1 << bits), (int64_t)1 << bits, saturated);
}

/* Limits to -2^bits .. 2^bits - 1, 32 <= bits <= 61: what lies within is told by its high half. */
static inline int64_t sat_below_power_i64(int64_t value, unsigned bits, bool *saturated)
{
    uint32_t limit = 1u << (bits - 32);
    if ((uint32_t)floor_shift_i64(value, 32) + limit < 2 * limit)
        return value;
    *saturated = true;
    return value < 0 ? -((int64_t)1 << bits) : ((int64_t)1 << bits) - 1;
}

static inline int32_t sat_i32(int64_t value, bool *saturated)
{
    if ((int32_t)value == value)
        return (int32_t)value;
    *saturated = true;
    return value < 0 ? INT32_MIN : INT32_MAX;
}

static inline int32_t sat_add_i32(int32_t a, int32_t b, bool *saturated)
{
    int32_t sum;
    if (!__builtin_add_overflow(a, b, &sum))
        return sum;
    *saturated = true;
    return b < 0 ? INT32_MIN : INT32_MAX;
}

static inline int32_t sat_sub_i32(int32_t a, int32_t b, bool *saturated)
{
    int32_t difference;
    if (!__builtin_sub_overflow(a, b, &difference))
        return difference;
    *saturated = true;
    return b < 0 ? INT32_MAX : INT32_MIN;
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

/* a x b / 2^bits, rounded to nearest, saturated to int32. */
static inline int32_t mul_shift_i32(int32_t a, int32_t b, unsigned bits, bool *saturated)
{
    return sat_i32(mul_shift_wide_i32(a, b, bits), saturated);
}

/* a + (b - a) x fraction, rounded to nearest. 0 <= fraction_q30 <= 2^30. */
static inline int32_t lerp_i32(int32_t a, int32_t b, uint32_t fraction_q30)
{
    return (int32_t)(a + round_shift_i64(((int64_t)b - a) * (int64_t)fraction_q30, 30));
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

static inline uint64_t magnitude_i64(int64_t value)
{
    return value < 0 ? 0 - (uint64_t)value : (uint64_t)value;
}

/* a x b / 2^bits, rounded to nearest, for |a| < 2^(bits + 31): two products instead of four. 1 <= bits <= 31. */
static inline int64_t mul_shift_i64_i32(int64_t a, int32_t b, unsigned bits)
{
    int64_t low = a & (((int64_t)1 << bits) - 1);
    return floor_shift_i64(a, bits) * b + round_shift_i64(low * b, bits);
}

/* A value as high x 2^32 + low with both halves signed, so that their products are too. |value| < 2^62. */
static inline int32_t signed_low_i64(int64_t value)
{
    return (int32_t)(uint32_t)value;
}

static inline int32_t signed_high_i64(int64_t value)
{
    return (int32_t)(value >> 32) + (int32_t)((uint32_t)value >> 31);
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
    sum += (int32_t)(middle >> 32);
    return sum + (int64_t)a_high * b_high;
}

/* High half of a product. */
static inline uint32_t mul_high_u32(uint32_t a, uint32_t b)
{
    return (uint32_t)(((uint64_t)a * b) >> 32);
}

/* 2^62 / b, or up to 2^-25 of it less; 2^31 <= b. Newton's iteration, each step doubling the bits, from the line that
 * is never more than 1/17 off. */
static inline uint32_t reciprocal_q62(uint32_t b)
{
    uint32_t inverse = 3031741620u - mul_high_u32(b, 2021161080u); /* 48/17 - 32/17 b, q30 */
    for (unsigned step = 0; step < 3; step++) {
        int32_t left_q30 = (1 << 30) - (int32_t)mul_high_u32(b, inverse);
        inverse += (uint32_t)floor_shift_i64((int64_t)inverse * left_q30, 30);
    }
    return inverse - 16;
}

/* a / b, towards 0, without a division and whatever the values as fast. a < 2^32 b. */
static inline uint32_t ratio_u32(uint64_t a, uint32_t b)
{
    unsigned spare = (unsigned)__builtin_clz(b);
    uint64_t divisor = b << spare, left = a << spare;
    uint32_t inverse = reciprocal_q62(b << spare);
    uint32_t first = (uint32_t)((uint64_t)(uint32_t)(left >> 32) * inverse >> 30); /* less than 2^8 short */
    left -= first * divisor;
    uint32_t second = (uint32_t)((uint64_t)(uint32_t)(left >> 9) * inverse >> 53);
    left -= second * divisor;
    uint32_t last = left >= 2 * divisor ? 2 : left >= divisor ? 1 : 0;
    return first + second + last;
}

/* a x b / 2^bits, rounded to nearest, saturated to int64. 1 <= bits <= 63. Four products: sparingly in a tick. */
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

#endif
