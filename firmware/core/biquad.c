#include "core/biquad.h"

#include "core/fixed.h"

#define COEFFICIENT_BITS 26
#define HALF_BITS 28

bool biquad_changes(const struct biquad_config *config)
{
    return (config->b1_q26 | config->b2_q26 | config->minus_a1_q26 | config->minus_a2_q26) != 0;
}

static int32_t minus(int32_t coefficient_q26)
{
    return (int32_t)(0u - (uint32_t)coefficient_q26);
}

struct biquad_config biquad_of(const int32_t c_q26[5])
{
    return (struct biquad_config){c_q26[0], c_q26[1], c_q26[2], minus(c_q26[3]), minus(c_q26[4])};
}

bool biquad_is_usable(const struct biquad_config *config)
{
    int64_t one = BIQUAD_ONE_Q26, a1 = -(int64_t)config->minus_a1_q26, a2 = -(int64_t)config->minus_a2_q26;
    bool stable = a2 < one && a1 < one + a2 && -a1 < one + a2;
    return stable && one + a1 + a2 == (int64_t)config->b0_q26 + config->b1_q26 + config->b2_q26;
}

void biquad_prime(struct biquad_state *state, struct biquad_value value)
{
    *state = (struct biquad_state){value, value, value, value};
}

static struct biquad_value admitted(struct biquad_value value)
{
    int32_t most = 1 << (BIQUAD_LIMIT_BITS_Q40 - HALF_BITS);
    return (struct biquad_value){clamp_i32(value.high_q12, -most, most - 1), value.low_q40 & ((1 << HALF_BITS) - 1)};
}

void biquad_admit(struct biquad_state *state)
{
    *state = (struct biquad_state){admitted(state->x1), admitted(state->x2), admitted(state->y1), admitted(state->y2)};
}

struct biquad_value biquad_split(int64_t value_q40)
{
    return (struct biquad_value){(int32_t)floor_shift_i64(value_q40, HALF_BITS),
                                 (int32_t)((uint32_t)value_q40 & ((1u << HALF_BITS) - 1))};
}

int64_t biquad_joined_q40(struct biquad_value value)
{
    return (int64_t)value.high_q12 * (1 << HALF_BITS) + value.low_q40;
}

struct biquad_value biquad_step(const struct biquad_config *config, struct biquad_state *state, struct biquad_value x,
                                bool *saturated)
{
    const struct biquad_value x1 = state->x1, x2 = state->x2, y1 = state->y1, y2 = state->y2;
    int64_t high = (int64_t)config->b0_q26 * x.high_q12;
    high += (int64_t)config->b1_q26 * x1.high_q12;
    high += (int64_t)config->b2_q26 * x2.high_q12;
    high += (int64_t)config->minus_a1_q26 * y1.high_q12;
    high += (int64_t)config->minus_a2_q26 * y2.high_q12;
    int64_t low = (int64_t)config->b0_q26 * x.low_q40;
    low += (int64_t)config->b1_q26 * x1.low_q40;
    low += (int64_t)config->b2_q26 * x2.low_q40;
    low += (int64_t)config->minus_a1_q26 * y1.low_q40;
    low += (int64_t)config->minus_a2_q26 * y2.low_q40;

    /* The sum is high x 2^28 + low, in q66. */
    int64_t y_q40 = round_shift_i64(low, COEFFICIENT_BITS) + high * (1 << (HALF_BITS - COEFFICIENT_BITS));
    y_q40 = sat_below_power_i64(y_q40, BIQUAD_LIMIT_BITS_Q40, saturated);
    *state = (struct biquad_state){x, x1, biquad_split(y_q40), y1};
    return state->y1;
}

int64_t biquad_step_q40(const struct biquad_config *config, struct biquad_state *state, int64_t x_q40, bool *saturated)
{
    return biquad_joined_q40(biquad_step(config, state, biquad_split(x_q40), saturated));
}
