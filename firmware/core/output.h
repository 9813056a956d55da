/* The last block before the converter: slew limit, then clamp.
 *
 * Exact. The clamp wins over the slew limit, and holds whatever the other numbers are. */
#ifndef PHASELEAD_CORE_OUTPUT_H
#define PHASELEAD_CORE_OUTPUT_H

#include <stdbool.h>
#include <stdint.h>

struct output_config {
    int32_t u_min_q24, u_max_q24; /* clamp, V */
    int32_t slew_q24;             /* largest change per tick, V */
};

/* `previous` is the output of the tick before. Returns the output; *limited is set when it is not `wanted`. */
int32_t output_limit_q24(const struct output_config *config, int32_t previous_q24, int32_t wanted_q24, bool *limited);

/* One tick nearer to the goal, by at most a step. */
int32_t output_ramp_q24(int32_t present_q24, int32_t goal_q24, int32_t step_q24);

#endif
