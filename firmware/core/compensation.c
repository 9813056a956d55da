#include "core/compensation.h"

#include "core/fixed.h"

#define Q16_TO_Q40 ((int64_t)1 << 24)
#define Q24_TO_Q40 ((int64_t)1 << 16)
#define Q40_TO_Q44 16
#define LIMIT_Q40 ((int64_t)1 << 55) /* 32768 um */

static void creep_on(const struct compensation *compensation, struct compensation_state *state)
{
    if (compensation->creeps == 0)
        return;
    int64_t x_q40 = round_shift_i64(state->inverse.x_q44, 4);
    creep_follow(&compensation->creep, &state->creep, x_q40 - compensation->rest_q16 * Q16_TO_Q40);
}

void compensation_follow(const struct compensation *compensation, struct compensation_state *state, int32_t u_q24)
{
    inverse_follow(&compensation->inverse, &state->inverse, u_q24);
    creep_on(compensation, state);
}

/* A constant goes through a section as it is: its static gain is exactly 1. */
static void prime(struct compensation_state *state, int64_t x_q40)
{
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++)
        biquad_prime(&state->shape[i], x_q40);
}

static inline int64_t shaped_q40(const struct compensation *compensation, struct compensation_state *state,
                                 int64_t x_q40, bool *saturated)
{
    if (state->primed == 0)
        prime(state, x_q40);
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++)
        if ((compensation->steps >> i & 1u) != 0)
            x_q40 = biquad_step_q40(&compensation->shape[i], &state->shape[i], x_q40, saturated);
    return x_q40;
}

static int32_t driven_q24(const struct compensation *compensation, struct compensation_state *state, int32_t v_q24,
                          bool *saturated)
{
    if (compensation->steps >> SHAPE_SECTIONS == 0)
        return v_q24;
    int64_t v_q40 = v_q24 * Q24_TO_Q40;
    if (state->primed == 0)
        biquad_prime(&state->drive, v_q40);
    int64_t u_q40 = biquad_step_q40(&compensation->drive, &state->drive, v_q40, saturated);
    return sat_i32(round_shift_i64(u_q40, 16), saturated);
}

int32_t compensation_step_q24(const struct compensation *compensation, struct compensation_state *state,
                              int32_t ahead_q16, bool *saturated)
{
    int64_t rest_q40 = compensation->rest_q16 * Q16_TO_Q40;
    int64_t x_q40 = shaped_q40(compensation, state, ahead_q16 * Q16_TO_Q40, saturated);
    if (compensation->creeps != 0)
        x_q40 = rest_q40 + creep_undo_q40(&compensation->creep, &state->creep, x_q40 - rest_q40);
    x_q40 = sat_between_i64(x_q40, -LIMIT_Q40, LIMIT_Q40 - 1, saturated);
    int32_t v_q24 = inverse_step_q24(&compensation->inverse, &state->inverse, x_q40 * Q40_TO_Q44, saturated);
    int32_t u_q24 = driven_q24(compensation, state, v_q24, saturated);
    state->primed = 1;
    creep_on(compensation, state);
    return u_q24;
}
