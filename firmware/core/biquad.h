/* One second-order section, direct form I: y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y''.
 *
 * Signals are q40 of whatever unit (micrometres, volts), coefficients q26. The five products are summed exactly; their
 * sum is rounded once, by half an LSB of q40 a tick before it goes round the loop. Values are limited to +-32768 units.
 */
#ifndef PHASELEAD_CORE_BIQUAD_H
#define PHASELEAD_CORE_BIQUAD_H

#include <stdbool.h>
#include <stdint.h>

#include "core/fixed.h"

#define BIQUAD_ONE_Q26 (1 << 26)
#define BIQUAD_COEFFICIENT_BITS 26
#define BIQUAD_HALF_BITS 28
#define BIQUAD_LIMIT_BITS_Q40 55 /* so that the high half stays within 2^27 */

struct biquad_config {
    int32_t b0_q26, b1_q26, b2_q26, minus_a1_q26, minus_a2_q26;
};

/* A q40 value as high x 2^28 + low, 0 <= low < 2^28: each half times a coefficient, five times over, fits 64 bits. */
struct biquad_value {
    int32_t high_q12, low_q40;
};

struct biquad_state {
    struct biquad_value x1, x2, y1, y2;
};

/* Of b0, b1, b2, a1, a2. What cannot change its sign is no stable section, and stays none. */
struct biquad_config biquad_of(const int32_t coefficients_q26[5]);

/* Stable, and with a static gain of exactly 1: 1 + a1 + a2 = b0 + b1 + b2. The one usable section without effect is b0
 * = 1 and nothing else. */
bool biquad_is_usable(const struct biquad_config *config);

/* A section that is not in use passes everything on; it need not be stepped. */
bool biquad_changes(const struct biquad_config *config);

/* As if the input had always been this value. */
void biquad_prime(struct biquad_state *state, struct biquad_value value);

/* A state that came from elsewhere may hold anything: brings it within what a step takes. Not for the tick. */
void biquad_admit(struct biquad_state *state);

/* |x| <= 32768 units. */
int64_t biquad_step_q40(const struct biquad_config *config, struct biquad_state *state, int64_t x_q40, bool *saturated);

/* The same for a cascade, whose sections hand on values in halves. */
static inline struct biquad_value biquad_split(int64_t value_q40)
{
    return (struct biquad_value){(int32_t)floor_shift_i64(value_q40, BIQUAD_HALF_BITS),
                                 (int32_t)((uint32_t)value_q40 & ((1u << BIQUAD_HALF_BITS) - 1))};
}

static inline struct biquad_value biquad_of_q16(int32_t value_q16)
{
    return (struct biquad_value){floor_shift_i32(value_q16, BIQUAD_HALF_BITS - 24),
                                 (int32_t)(((uint32_t)value_q16 & 15u) << 24)};
}

static inline struct biquad_value biquad_of_q24(int32_t value_q24)
{
    return (struct biquad_value){floor_shift_i32(value_q24, BIQUAD_HALF_BITS - 16),
                                 (int32_t)(((uint32_t)value_q24 & 0xfffu) << 16)};
}

static inline int64_t biquad_joined_q40(struct biquad_value value)
{
    return (int64_t)value.high_q12 * (1 << BIQUAD_HALF_BITS) + value.low_q40;
}

_Static_assert(sizeof(struct biquad_config) == 20 && sizeof(struct biquad_state) == 32,
               "the board's own instructions know where each number lies");

struct biquad_sum { /* high x 2^28 + low: five products and the half that rounds, exactly */
    int64_t high, low;
};

/* What a section is made of; its past moves on by x. */
#if defined(__ARM_FEATURE_DSP) && defined(__GNUC__)
/* In the board's own instructions, 20 where GCC 12 makes some 30 of the lines below: it loads each half by itself where
 * it is used, and moves the sums about. */
static inline __attribute__((always_inline)) struct biquad_sum
biquad_sum(const struct biquad_config *config, struct biquad_state *state, struct biquad_value x)
{
    uint32_t low_0 = 1u << (BIQUAD_COEFFICIENT_BITS - 1), low_1 = 0, high_0, high_1;
    int32_t c, d, high, low; /* two coefficients, a value of the past */
    __asm("ldrd  %[c], %[d], [%[config]]\n\t"
          "ldrd  %[h], %[l], [%[state]]\n\t"
          "strd  %[xh], %[xl], [%[state]]\n\t"
          "smlal %[l0], %[l1], %[c], %[xl]\n\t"
          "smull %[h0], %[h1], %[c], %[xh]\n\t"
          "smlal %[l0], %[l1], %[d], %[l]\n\t"
          "smlal %[h0], %[h1], %[d], %[h]\n\t"
          "ldr   %[c], [%[config], #8]\n\t"
          "ldrd  %[xh], %[xl], [%[state], #8]\n\t"
          "strd  %[h], %[l], [%[state], #8]\n\t"
          "smlal %[l0], %[l1], %[c], %[xl]\n\t"
          "smlal %[h0], %[h1], %[c], %[xh]\n\t"
          "ldrd  %[c], %[d], [%[config], #12]\n\t"
          "ldrd  %[h], %[l], [%[state], #16]\n\t"
          "ldrd  %[xh], %[xl], [%[state], #24]\n\t"
          "strd  %[h], %[l], [%[state], #24]\n\t"
          "smlal %[l0], %[l1], %[c], %[l]\n\t"
          "smlal %[h0], %[h1], %[c], %[h]\n\t"
          "smlal %[l0], %[l1], %[d], %[xl]\n\t"
          "smlal %[h0], %[h1], %[d], %[xh]"
          : [l0] "+&r"(low_0), [l1] "+&r"(low_1), [h0] "=&r"(high_0), [h1] "=&r"(high_1), [c] "=&r"(c), [d] "=&r"(d),
            [h] "=&r"(high), [l] "=&r"(low), [xh] "+&r"(x.high_q12), [xl] "+&r"(x.low_q40)
          : [config] "r"(config), [state] "r"(state)
          : "memory");
    return (struct biquad_sum){(int64_t)((uint64_t)high_1 << 32 | high_0), (int64_t)((uint64_t)low_1 << 32 | low_0)};
}
#else
static inline struct biquad_sum biquad_sum(const struct biquad_config *config, struct biquad_state *state,
                                           struct biquad_value x)
{
    const struct biquad_value x1 = state->x1, x2 = state->x2, y1 = state->y1, y2 = state->y2;
    struct biquad_sum sum = {(int64_t)config->b0_q26 * x.high_q12, (int64_t)config->b0_q26 * x.low_q40};
    sum.high += (int64_t)config->b1_q26 * x1.high_q12;
    sum.high += (int64_t)config->b2_q26 * x2.high_q12;
    sum.high += (int64_t)config->minus_a1_q26 * y1.high_q12;
    sum.high += (int64_t)config->minus_a2_q26 * y2.high_q12;
    sum.low += 1 << (BIQUAD_COEFFICIENT_BITS - 1);
    sum.low += (int64_t)config->b1_q26 * x1.low_q40;
    sum.low += (int64_t)config->b2_q26 * x2.low_q40;
    sum.low += (int64_t)config->minus_a1_q26 * y1.low_q40;
    sum.low += (int64_t)config->minus_a2_q26 * y2.low_q40;
    state->x2 = x1;
    state->x1 = x;
    state->y2 = y1;
    return sum;
}
#endif

static inline __attribute__((always_inline)) struct biquad_value
biquad_step(const struct biquad_config *config, struct biquad_state *state, struct biquad_value x, bool *saturated)
{
    const struct biquad_sum sum = biquad_sum(config, state, x);
    int64_t y_q40 = floor_shift_i64(sum.low, BIQUAD_COEFFICIENT_BITS);
    y_q40 += sum.high * (1 << (BIQUAD_HALF_BITS - BIQUAD_COEFFICIENT_BITS));
    y_q40 = sat_below_power_i64(y_q40, BIQUAD_LIMIT_BITS_Q40, saturated);
    const struct biquad_value y = biquad_split(y_q40);
    state->y1 = y;
    return y;
}

#endif
