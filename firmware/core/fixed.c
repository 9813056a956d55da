#include "core/fixed.h"

uint64_t mul_wide_u64(uint64_t a, uint64_t b, uint64_t *low)
{
    uint64_t a0 = (uint32_t)a, a1 = a >> 32, b0 = (uint32_t)b, b1 = b >> 32;
    uint64_t p00 = a0 * b0, p01 = a0 * b1, p10 = a1 * b0;
    uint64_t middle = (p00 >> 32) + (uint32_t)p01 + (uint32_t)p10;
    *low = (middle << 32) | (uint32_t)p00;
    return a1 * b1 + (p01 >> 32) + (p10 >> 32) + (middle >> 32);
}

int64_t mul_shift_i64(int64_t a, int64_t b, unsigned bits, bool *saturated)
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

static uint32_t mul_high_u32(uint32_t a, uint32_t b)
{
    return (uint32_t)(((uint64_t)a * b) >> 32);
}

/* 2^62 / b, or up to 2^-25 of it less; 2^31 <= b. Newton's iteration, each step doubling the bits, from the line that
 * is never more than 1/17 off. */
static uint32_t reciprocal_q62(uint32_t b)
{
    uint32_t inverse = 3031741620u - mul_high_u32(b, 2021161080u); /* 48/17 - 32/17 b, q30 */
    for (unsigned step = 0; step < 3; step++) {
        int32_t error_q30 = (1 << 30) - (int32_t)mul_high_u32(b, inverse);
        inverse += (uint32_t)floor_shift_i64((int64_t)inverse * error_q30, 30);
    }
    return inverse - 16;
}

uint32_t ratio_u32(uint64_t a, uint32_t b)
{
    unsigned spare = leading_zeros_u32(b);
    uint64_t divisor = b << spare, rest = a << spare;
    uint32_t inverse = reciprocal_q62(b << spare);
    uint32_t first = (uint32_t)((uint64_t)(uint32_t)(rest >> 32) * inverse >> 30); /* less than 2^8 short */
    rest -= first * divisor;
    uint32_t second = (uint32_t)((uint64_t)(uint32_t)(rest >> 9) * inverse >> 53);
    rest -= second * divisor;
    uint32_t last = rest >= 2 * divisor ? 2 : rest >= divisor ? 1 : 0;
    return first + second + last;
}
