#include "core/compensation.h"

#include "core/fixed.h"

#define Q40_TO_Q44 16

static void creep_on(const struct compensation *compensation, struct compensation_state *state)
{
    if (compensation->creep.fours == 0)
        return;
    int64_t x_q40 = round_shift_i64(state->inverse.x_q44, 4);
    creep_follow(&compensation->creep, &state->creep, x_q40 - compensation->rest_q40);
}

void compensation_follow(const struct compensation *compensation, struct compensation_state *state, int32_t u_q24)
{
    inverse_follow(&compensation->inverse, &state->inverse, u_q24);
    creep_on(compensation, state);
}

/* A constant goes through a section as it is: its static gain is exactly 1. */
static __attribute__((noinline)) void prime(struct compensation_state *state, struct biquad_value value)
{
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++)
        biquad_prime(&state->shape[i], value);
}

/* With a constant section: to pass over one is a test of a bit. */
static inline __attribute__((always_inline)) struct biquad_value shaped_once(const struct compensation *compensation,
                                                                             struct compensation_state *state,
                                                                             unsigned section,
                                                                             struct biquad_value value, bool *saturated)
{
    if (__builtin_expect((compensation->steps >> section & 1u) != 0, true)) /* what counts is a tick that has all */
        value = biquad_step(&compensation->shape[section], &state->shape[section], value, saturated);
    return value;
}

_Static_assert(SHAPE_SECTIONS == 6, "a tick names its sections one by one");

static inline int64_t shaped_q40(const struct compensation *compensation, struct compensation_state *state,
                                 int32_t ahead_q16, bool *saturated)
{
    struct biquad_value value = biquad_of_q16(ahead_q16);
    if (state->primed == 0)
        prime(state, value);
    value = shaped_once(compensation, state, 0, value, saturated);
    value = shaped_once(compensation, state, 1, value, saturated);
    value = shaped_once(compensation, state, 2, value, saturated);
    value = shaped_once(compensation, state, 3, value, saturated);
    value = shaped_once(compensation, state, 4, value, saturated);
    value = shaped_once(compensation, state, 5, value, saturated);
    return biquad_joined_q40(value);
}

static int32_t driven_q24(const struct compensation *compensation, struct compensation_state *state, int32_t v_q24,
                          bool *saturated)
{
    if (compensation->steps >> SHAPE_SECTIONS == 0)
        return v_q24;
    const struct biquad_value v = biquad_of_q24(v_q24);
    if (state->primed == 0)
        biquad_prime(&state->drive, v);
    const struct biquad_value u = biquad_step(&compensation->drive, &state->drive, v, saturated);
    return sat_i32(round_shift_i64(biquad_joined_q40(u), 16), saturated);
}

int32_t compensation_step_q24(const struct compensation *compensation, struct compensation_state *state,
                              int32_t ahead_q16, bool *saturated)
{
    int64_t x_q40 = shaped_q40(compensation, state, ahead_q16, saturated);
    if (compensation->creep.fours != 0) {
        const int64_t rest_q40 = compensation->rest_q40;
        x_q40 = rest_q40 + creep_undo_q40(&compensation->creep, &state->creep, x_q40 - rest_q40);
        x_q40 = sat_below_power_i64(x_q40, BIQUAD_LIMIT_BITS_Q40, saturated); /* 32768 um */
    }
    int32_t v_q24 = inverse_step_q24(&compensation->inverse, &state->inverse, x_q40 * Q40_TO_Q44, saturated);
    int32_t u_q24 = driven_q24(compensation, state, v_q24, saturated);
    state->primed = 1;
    creep_on(compensation, state);
    return u_q24;
}
