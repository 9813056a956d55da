#include "core/biquad.h"

#include "core/fixed.h"

#define LIMIT_Q40 (((int64_t)1 << 55) - 1) /* five products with 32 stay below 2^63 */

bool biquad_is_usable(const struct biquad_config *config)
{
    int64_t one = BIQUAD_ONE_Q26, a1 = config->a1_q26, a2 = config->a2_q26;
    bool stable = a2 < one && a1 < one + a2 && -a1 < one + a2;
    return stable && one + a1 + a2 == (int64_t)config->b0_q26 + config->b1_q26 + config->b2_q26;
}

void biquad_prime(struct biquad_state *state, int64_t value_q40)
{
    *state = (struct biquad_state){value_q40, value_q40, value_q40, value_q40};
}

/* A state that was read back from elsewhere may hold anything. */
static int64_t product_q40(int64_t value_q40, int32_t coefficient_q26, bool *saturated)
{
    return mul_shift_i64_i32(sat_between_i64(value_q40, -LIMIT_Q40, LIMIT_Q40, saturated), coefficient_q26, 26);
}

int64_t biquad_step_q40(const struct biquad_config *config, struct biquad_state *state, int64_t x_q40, bool *saturated)
{
    x_q40 = sat_between_i64(x_q40, -LIMIT_Q40, LIMIT_Q40, saturated);
    int64_t sum_q40 = product_q40(x_q40, config->b0_q26, saturated);
    sum_q40 += product_q40(state->x1_q40, config->b1_q26, saturated);
    sum_q40 += product_q40(state->x2_q40, config->b2_q26, saturated);
    sum_q40 -= product_q40(state->y1_q40, config->a1_q26, saturated);
    sum_q40 -= product_q40(state->y2_q40, config->a2_q26, saturated);
    int64_t y_q40 = sat_between_i64(sum_q40, -LIMIT_Q40, LIMIT_Q40, saturated);
    *state = (struct biquad_state){x_q40, state->x1_q40, y_q40, state->y1_q40};
    return y_q40;
}
