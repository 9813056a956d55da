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
#define BIQUAD_LIMIT_BITS_Q40 55 /* +-32768 units */

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

/* From b0, b1, b2, a1, a2. A coefficient INT32_MIN has no negative: it stays, and the section is not usable. */
struct biquad_config biquad_of(const int32_t c_q26[5]);

/* Stable, and with a static gain of exactly 1: 1 + a1 + a2 = b0 + b1 + b2. The one usable section without effect is b0
 * = 1 and nothing else. */
bool biquad_is_usable(const struct biquad_config *config);

/* False for a section that passes everything on; it need not be stepped. */
bool biquad_changes(const struct biquad_config *config);

/* As if the input had always been this value. */
void biquad_prime(struct biquad_state *state, int64_t value_q40);

/* A state that came from elsewhere may hold anything: brings it within what a step takes. Not for the tick. */
void biquad_admit(struct biquad_state *state);

/* |x| <= 32768 units. */
int64_t biquad_step_q40(const struct biquad_config *config, struct biquad_state *state, int64_t x_q40, bool *saturated);

static inline struct biquad_value biquad_split(int64_t value_q40)
{
    return (struct biquad_value){(int32_t)floor_shift_i64(value_q40, BIQUAD_HALF_BITS),
                                 (int32_t)((uint32_t)value_q40 & ((1u << BIQUAD_HALF_BITS) - 1))};
}

struct biquad_sums { /* high x 2^28 + low, in q66 */
    int64_t high, low;
};

static inline void biquad_add(struct biquad_sums *sums, int32_t coefficient_q26, struct biquad_value value)
{
    sums->high += (int64_t)coefficient_q26 * value.high_q12;
    sums->low += (int64_t)coefficient_q26 * value.low_q40;
}

/* The same as a part of the loop over a cascade. Each place of the state is written as soon as it is read: a processor
 * of 32 bits has registers for no more. */
static inline int64_t biquad_inline_step_q40(const struct biquad_config *config, struct biquad_state *state,
                                             int64_t x_q40, bool *saturated)
{
    struct biquad_sums sums = {0, 0};
    const struct biquad_value x = biquad_split(x_q40), x1 = state->x1;
    state->x1 = x;
    biquad_add(&sums, config->b0_q26, x);
    biquad_add(&sums, config->b1_q26, x1);
    biquad_add(&sums, config->b2_q26, state->x2);
    state->x2 = x1;
    const struct biquad_value y1 = state->y1;
    biquad_add(&sums, config->minus_a1_q26, y1);
    biquad_add(&sums, config->minus_a2_q26, state->y2);
    state->y2 = y1;
    const int64_t low_q40 = round_shift_i64(sums.low, BIQUAD_COEFFICIENT_BITS);
    const int64_t y_q40 = low_q40 + sums.high * (1 << (BIQUAD_HALF_BITS - BIQUAD_COEFFICIENT_BITS));
    const int64_t limited_q40 = sat_below_power_i64(y_q40, BIQUAD_LIMIT_BITS_Q40, saturated);
    state->y1 = biquad_split(limited_q40);
    return limited_q40;
}

#endif
