/* What a compensation needs when a model is committed or a state put back. Never called in a tick. */
#include "core/compensation.h"
#include "core/fixed.h"

bool compensation_make(struct compensation *compensation)
{
    bool beyond = false;
    compensation->steps = 0;
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++)
        compensation->steps |= (uint32_t)biquad_changes(&compensation->shape[i]) << i;
    compensation->steps |= (uint32_t)biquad_changes(&compensation->drive) << SHAPE_SECTIONS;
    compensation->rest_q16 = sat_i32(round_shift_i64(compensation->inverse.rest_x_q44, 28), &beyond);
    compensation->rest_q40 = compensation->rest_q16 * ((int64_t)1 << 24);
    return !beyond;
}

void compensation_rest(const struct compensation *compensation, struct compensation_state *state, int32_t u_q24)
{
    *state = (struct compensation_state){.primed = 0};
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
