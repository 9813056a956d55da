#include "core/compensation.h"

#include <stddef.h>

#include "core/fixed.h"
#include "core/inverse_memory.h"

#define Q40_TO_Q44 16

bool compensation_make(struct compensation *compensation)
{
    bool beyond = false;
    compensation->sections_in_use = 0;
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++)
        if (biquad_changes(&compensation->shape[i]))
            compensation->sections_in_use |= 1u << i;
    if (biquad_changes(&compensation->drive))
        compensation->sections_in_use |= DRIVE_IN_USE;
    compensation->rest_q16 = sat_i32(round_shift_i64(compensation->inverse.rest_x_q44, 28), &beyond);
    compensation->rest_q40 = compensation->rest_q16 * ((int64_t)1 << 24);
    return !beyond;
}

void compensation_rest(const struct compensation *compensation, struct compensation_state *state, int32_t u_q24)
{
    state->primed = 0; /* so that the first step primes the sections */
    state->creep = (struct creep_state){{0}};
    inverse_rest(&compensation->inverse, &state->inverse, u_q24);
}

void compensation_admit(const struct compensation *compensation, struct compensation_state *state)
{
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++)
        biquad_admit(&state->shape[i]);
    biquad_admit(&state->drive);
    creep_admit(&state->creep);
    inverse_admit(&compensation->inverse, &state->inverse);
}

static void follow_creep(const struct compensation *compensation, struct compensation_state *state)
{
    int64_t x_q40 = round_shift_i64(state->inverse.x_q44, 4);
    creep_follow(&compensation->creep, &state->creep, x_q40 - compensation->rest_q40);
}

void compensation_follow(const struct compensation *compensation, struct compensation_state *state, int32_t u_q24)
{
    inverse_follow(&compensation->inverse, &state->inverse, u_q24);
    follow_creep(compensation, state);
}

int32_t compensation_here_q16(const struct compensation *compensation, const struct compensation_state *state)
{
    bool saturated = false;
    if (compensation == NULL)
        return 0;
    const int64_t here_q16 = round_shift_i64(state->inverse.x_q44, 28);
    return sat_i32(here_q16 + creep_so_far_q16(&compensation->creep, &state->creep), &saturated);
}

/* A constant passes each section unchanged, since its static gain is exactly 1: all start from the same value. */
static void prime_shape(struct compensation_state *state, int64_t value_q40)
{
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++)
        biquad_prime(&state->shape[i], value_q40);
}

static int64_t shaped_q40(const struct compensation *compensation, struct compensation_state *state, int32_t ahead_q16,
                          bool *saturated)
{
    int64_t x_q40 = ahead_q16 * ((int64_t)1 << 24);
    if (state->primed == 0)
        prime_shape(state, x_q40);
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++)
        if ((compensation->sections_in_use >> i & 1u) != 0)
            x_q40 = biquad_inline_step_q40(&compensation->shape[i], &state->shape[i], x_q40, saturated);
    return x_q40;
}

static int64_t without_creep_q40(const struct compensation *compensation, const struct compensation_state *state,
                                 int64_t x_q40, bool *saturated)
{
    if (!creep_is_in_use(&compensation->creep))
        return x_q40;
    const int64_t rest_q40 = compensation->rest_q40;
    x_q40 = rest_q40 + creep_undo_q40(&compensation->creep, &state->creep, x_q40 - rest_q40);
    return sat_below_power_i64(x_q40, BIQUAD_LIMIT_BITS_Q40, saturated); /* 32768 um */
}

static int32_t driven_q24(const struct compensation *compensation, struct compensation_state *state, int32_t v_q24,
                          bool *saturated)
{
    if ((compensation->sections_in_use & DRIVE_IN_USE) == 0)
        return v_q24;
    const int64_t v_q40 = v_q24 * ((int64_t)1 << 16);
    if (state->primed == 0)
        biquad_prime(&state->drive, v_q40);
    const int64_t u_q40 = biquad_step_q40(&compensation->drive, &state->drive, v_q40, saturated);
    return sat_i32(round_shift_i64(u_q40, 16), saturated);
}

int32_t compensation_step_q24(const struct compensation *compensation, struct compensation_state *state,
                              int32_t ahead_q16, int32_t most_q24, bool *saturated)
{
    int64_t x_q40 = shaped_q40(compensation, state, ahead_q16, saturated);
    x_q40 = without_creep_q40(compensation, state, x_q40, saturated);
    int32_t v_q24 = inverse_step_q24(&compensation->inverse, &state->inverse, x_q40 * Q40_TO_Q44, most_q24, saturated);
    int32_t u_q24 = driven_q24(compensation, state, v_q24, saturated);
    state->primed = 1;
    follow_creep(compensation, state);
    return u_q24;
}
