#include "core/biquad.h"

#include "core/fixed.h"

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

static struct biquad_value admitted(struct biquad_value value)
{
    int32_t most = 1 << (BIQUAD_LIMIT_BITS_Q40 - BIQUAD_HALF_BITS);
    return (struct biquad_value){clamp_i32(value.high_q12, -most, most - 1),
                                 value.low_q40 & ((1 << BIQUAD_HALF_BITS) - 1)};
}

void biquad_admit(struct biquad_state *state)
{
    *state = (struct biquad_state){admitted(state->x1), admitted(state->x2), admitted(state->y1), admitted(state->y2)};
}

void biquad_prime(struct biquad_state *state, int64_t value_q40)
{
    const struct biquad_value value = biquad_split(value_q40);
    *state = (struct biquad_state){value, value, value, value};
}

int64_t biquad_step_q40(const struct biquad_config *config, struct biquad_state *state, int64_t x_q40, bool *saturated)
{
    return biquad_inline_step_q40(config, state, x_q40, saturated);
}
