/* Second-order sections behind the PID: notches, low-passes, lags and leads that shape the loop.
 *
 *     y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y''        V q24, coefficients q26
 *
 * They stand behind the PID, not before it: its integrator and what takes its wind-up back see the error as it is, and
 * a static gain of exactly 1 makes them begin without a bump. Where none is in use no bit changes.
 *
 * The five products are summed exactly, together with what was rounded off in the tick before (26 bits): so the output
 * has 50 fractional bits on average, a constant stays exactly what it is, and no section creeps or rings in its last
 * bit. That is what the two halves of biquad.h are for; here they would cost more than a tick has before its output.
 */
#ifndef PHASELEAD_CORE_LOOP_FILTER_H
#define PHASELEAD_CORE_LOOP_FILTER_H

#include "core/biquad.h"

#define LOOP_SECTIONS 2

struct loop_filter_config {
    uint32_t in_use; /* bit i: section[i] */
    struct biquad_config section[LOOP_SECTIONS];
};

struct loop_section_state {
    int32_t x1_q24, x2_q24, y1_q24, y2_q24;
    uint32_t rest_q50; /* what y1 lacks, below 2^26 */
};

struct loop_filter_state {
    uint32_t primed; /* bit i: section[i] has begun; others begin as if their first input had always been there */
    uint32_t reserved;
    struct loop_section_state section[LOOP_SECTIONS];
};

/* Takes sections as they come, all of one 0 where there is none. False when one is not usable. */
bool loop_filter_make(struct loop_filter_config *config, const struct biquad_config sections[LOOP_SECTIONS]);

/* Each section in use is usable as such (biquad.h), with every b below 16. */
bool loop_filter_is_usable(const struct loop_filter_config *config);

/* Other sections from the next step on: those in use before and after go on from where they are. */
void loop_filter_exchange(const struct loop_filter_config *before, const struct loop_filter_config *after,
                          struct loop_filter_state *state);

int32_t loop_filter_step_q24(const struct loop_filter_config *config, struct loop_filter_state *state, int32_t u_q24,
                             bool *saturated);

#endif
