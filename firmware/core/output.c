#include "core/output.h"

#include "core/fixed.h"

int32_t output_limit_q24(const struct output_config *config, int32_t previous_q24, int32_t wanted_q24, bool *limited)
{
    int32_t low_q24 = sub_i32(previous_q24, config->slew_q24), high_q24 = add_i32(previous_q24, config->slew_q24);
    int32_t slewed_q24 = clamp_i32(wanted_q24, low_q24, high_q24);
    int32_t u_q24 = clamp_i32(slewed_q24, config->u_min_q24, config->u_max_q24);
    if (u_q24 != wanted_q24)
        *limited = true;
    return u_q24;
}

int32_t output_ramp_q24(int32_t present_q24, int32_t goal_q24, int32_t step_q24)
{
    int32_t way_q24 = sub_i32(goal_q24, present_q24);
    return add_i32(present_q24, clamp_i32(way_q24, sub_i32(0, step_q24), step_q24));
}
