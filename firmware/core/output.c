#include "core/output.h"

#include "core/fixed.h"

int32_t output_limit_q24(const struct output_config *config, int32_t previous_q24, int32_t wanted_q24, bool *limited)
{
    int64_t step_q24 = (int64_t)wanted_q24 - previous_q24;
    int32_t u_q24 = wanted_q24;
    if (step_q24 > config->slew_q24)
        u_q24 = sat_i32((int64_t)previous_q24 + config->slew_q24, limited);
    else if (step_q24 < -(int64_t)config->slew_q24)
        u_q24 = sat_i32((int64_t)previous_q24 - config->slew_q24, limited);
    u_q24 = clamp_i32(u_q24, config->u_min_q24, config->u_max_q24);
    if (u_q24 != wanted_q24)
        *limited = true;
    return u_q24;
}
