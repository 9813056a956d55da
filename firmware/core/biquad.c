#include "core/biquad.h"

#include "core/fixed.h"

#define HALF_BITS 28
#define COEFFICIENT_BITS 26
#define LIMIT_Q40 ((int64_t)1 << 55) /* so that the high half stays within 2^27 */

static struct biquad_value split(int64_t value_q40)
{
    return (struct biquad_value){(int32_t)floor_shift_i64(value_q40, HALF_BITS),
                                 (int32_t)(value_q40 & ((1 << HALF_BITS) - 1))};
}

bool biquad_changes(const struct biquad_config *config)
{
    return (config->b1_q26 | config->b2_q26 | config->a1_q26 | config->a2_q26) != 0;
}

bool biquad_is_usable(const struct biquad_config *config)
{
    int64_t one = BIQUAD_ONE_Q26, a1 = config->a1_q26, a2 = config->a2_q26;
    bool stable = a2 < one && a1 < one + a2 && -a1 < one + a2;
    return stable && one + a1 + a2 == (int64_t)config->b0_q26 + config->b1_q26 + config->b2_q26;
}

void biquad_prime(struct biquad_state *state, int64_t value_q40)
{
    struct biquad_value value = split(value_q40);
    *state = (struct biquad_state){value, value, value, value};
}

static struct biquad_value admitted(struct biquad_value value)
{
    int32_t most = LIMIT_Q40 / (1 << HALF_BITS);
    return (struct biquad_value){clamp_i32(value.high_q12, -most, most - 1), value.low_q40 & ((1 << HALF_BITS) - 1)};
}

void biquad_admit(struct biquad_state *state)
{
    *state = (struct biquad_state){admitted(state->x1), admitted(state->x2), admitted(state->y1), admitted(state->y2)};
}

/* A stable section's a1 and a2 are below 2, so that they can change their sign. */
static int32_t minus(int32_t value)
{
    return (int32_t)(0u - (uint32_t)value);
}

int64_t biquad_step_q40(const struct biquad_config *config, struct biquad_state *state, int64_t x_q40, bool *saturated)
{
    const struct biquad_value x = split(x_q40), x1 = state->x1, x2 = state->x2, y1 = state->y1, y2 = state->y2;
    const int32_t b0 = config->b0_q26, b1 = config->b1_q26, b2 = config->b2_q26;
    const int32_t a1 = minus(config->a1_q26), a2 = minus(config->a2_q26);
    int64_t high = (int64_t)b0 * x.high_q12;
    high += (int64_t)b1 * x1.high_q12;
    high += (int64_t)b2 * x2.high_q12;
    high += (int64_t)a1 * y1.high_q12;
    high += (int64_t)a2 * y2.high_q12;
    int64_t low = (int64_t)b0 * x.low_q40 + (1 << (COEFFICIENT_BITS - 1)); /* and the half that rounds */
    low += (int64_t)b1 * x1.low_q40;
    low += (int64_t)b2 * x2.low_q40;
    low += (int64_t)a1 * y1.low_q40;
    low += (int64_t)a2 * y2.low_q40;
    int64_t y_q40 = high * (1 << (HALF_BITS - COEFFICIENT_BITS)) + floor_shift_i64(low, COEFFICIENT_BITS);
    y_q40 = sat_between_i64(y_q40, -LIMIT_Q40, LIMIT_Q40 - 1, saturated);
    state->x2 = x1;
    state->x1 = x;
    state->y2 = y1;
    state->y1 = split(y_q40);
    return y_q40;
}
