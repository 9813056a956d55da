#include "core/loop_filter.h"

#include "core/fixed.h"

#define REST_BITS 26
#define B_LIMIT_Q26 ((uint64_t)1 << 30) /* 16: three products of it, and those with a1 and a2, fit 64 bits */

static bool is_none(const struct biquad_config *section)
{
    return section->b0_q26 == 0 && !biquad_changes(section);
}

static bool is_usable(const struct biquad_config *section)
{
    return biquad_is_usable(section) && magnitude_i64(section->b0_q26) < B_LIMIT_Q26 &&
           magnitude_i64(section->b1_q26) < B_LIMIT_Q26 && magnitude_i64(section->b2_q26) < B_LIMIT_Q26;
}

bool loop_filter_make(struct loop_filter_config *config, const struct biquad_config sections[LOOP_SECTIONS])
{
    *config = (struct loop_filter_config){0};
    for (unsigned i = 0; i < LOOP_SECTIONS; i++) {
        config->section[i] = sections[i];
        config->in_use |= is_none(&sections[i]) ? 0 : 1u << i;
    }
    return loop_filter_is_usable(config);
}

bool loop_filter_is_usable(const struct loop_filter_config *config)
{
    for (unsigned i = 0; i < LOOP_SECTIONS; i++)
        if ((config->in_use >> i & 1u) != 0 && !is_usable(&config->section[i]))
            return false;
    return true;
}

void loop_filter_exchange(const struct loop_filter_config *before, const struct loop_filter_config *after,
                          struct loop_filter_state *state)
{
    state->primed &= before->in_use & after->in_use;
}

static int32_t section_step_q24(const struct biquad_config *config, struct loop_section_state *state, int32_t x_q24,
                                bool *saturated)
{
    const int32_t y1_q24 = state->y1_q24;
    int64_t sum_q50 = (int64_t)config->b0_q26 * x_q24 + state->rest_q50;
    sum_q50 += (int64_t)config->b1_q26 * state->x1_q24;
    sum_q50 += (int64_t)config->b2_q26 * state->x2_q24;
    sum_q50 += (int64_t)config->minus_a1_q26 * y1_q24;
    sum_q50 += (int64_t)config->minus_a2_q26 * state->y2_q24;
    state->x2_q24 = state->x1_q24;
    state->x1_q24 = x_q24;
    state->y2_q24 = y1_q24;
    state->y1_q24 = sat_i32(floor_shift_i64(sum_q50, REST_BITS), saturated);
    state->rest_q50 = (uint32_t)sum_q50 & ((1u << REST_BITS) - 1);
    return state->y1_q24;
}

int32_t loop_filter_step_q24(const struct loop_filter_config *config, struct loop_filter_state *state, int32_t u_q24,
                             bool *saturated)
{
    for (unsigned i = 0; i < LOOP_SECTIONS; i++)
        if ((config->in_use >> i & 1u) != 0) {
            struct loop_section_state *section = &state->section[i];
            if ((state->primed >> i & 1u) == 0)
                *section = (struct loop_section_state){u_q24, u_q24, u_q24, u_q24, 1u << (REST_BITS - 1)};
            u_q24 = section_step_q24(&config->section[i], section, u_q24, saturated);
        }
    state->primed = config->in_use;
    return u_q24;
}
