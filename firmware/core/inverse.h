/* The inverse of the time view: the voltage v at which
 *
 *     x = offset + gain v + sum w_i play_ri[v] + sum s_j max(v - d_j, 0)      (Kuhnen 2003, eqs. 5, 8, 30)
 *
 * is a given position. From where the plays stand, x is a rising line with bends at p_i + r_i and d_j (going up): the
 * inverse walks along it from the present voltage, bend by bend. That is exact: Krejci and Kuhnen's closed form needs
 * plays and dead zones in series, these are in parallel. A tick has time for so many bends; a jump over more of them
 * (which the slew limit would spread anyway) is finished in the ticks that follow.
 *
 * x is an exact integer (q44); the voltage is the nearest q24, so that x is met to half an LSB of it times the slope.
 */
#ifndef PHASELEAD_CORE_INVERSE_H
#define PHASELEAD_CORE_INVERSE_H

#include <stdbool.h>
#include <stdint.h>

#define INVERSE_PLAYS 32
#define INVERSE_KNOTS 24
#define INVERSE_BENDS_A_TICK 12
#define INVERSE_UNUSED INT32_MAX /* threshold of a place that is not in use: it costs next to nothing in the tick */

struct inverse_config {
    int32_t u_min_q24, u_max_q24; /* the inverse exists, and stays, within these */
    int32_t gain_q20;             /* um/V */
    int32_t offset_q16;
    int32_t rest_fraction_q30;
    int32_t play_r_q24[INVERSE_PLAYS]; /* never falling; those not in use: INVERSE_UNUSED */
    int32_t play_w_q20[INVERSE_PLAYS]; /* um/V, not negative */
    int32_t knot_d_q24[INVERSE_KNOTS]; /* never falling; those not in use: INVERSE_UNUSED */
    int32_t knot_s_q20[INVERSE_KNOTS];
};

struct inverse_state {
    int32_t v_q24;
    int32_t play_q24[INVERSE_PLAYS];
};

enum inverse_verdict {
    INVERSE_EXISTS,
    INVERSE_REST_BEYOND_THRESHOLDS,
    INVERSE_PLAYS_OUT_OF_ORDER,
    INVERSE_WEIGHT_NEGATIVE,
    INVERSE_KNOTS_OUT_OF_ORDER,
    INVERSE_TOO_STEEP, /* all slopes together reach 1024 um/V */
    INVERSE_FALLS,     /* somewhere within the limits the position rises by less than 2^-10 um/V after a turn */
};

enum inverse_verdict inverse_check(const struct inverse_config *config);

/* Plays of a stage at rest at 0 V, then moved to v. */
void inverse_rest(const struct inverse_config *config, struct inverse_state *state, int32_t v_q24);

/* The memory when the voltage has gone straight to v. */
void inverse_follow(const struct inverse_config *config, struct inverse_state *state, int32_t v_q24);

/* Where the stage stands by its memory. */
int64_t inverse_position_q44(const struct inverse_config *config, const struct inverse_state *state);

/* Goes to the voltage at which the position is x, or to the limit or the last bend of this tick before it, and then
 * sets *saturated; returns it. |x| < 2^15 um. */
int32_t inverse_step_q24(const struct inverse_config *config, struct inverse_state *state, int64_t x_q44,
                         bool *saturated);

/* What can be reached whatever the memory: from everything drawn down to u_min, to everything pushed up to u_max. */
void inverse_reach_q16(const struct inverse_config *config, int32_t *low_q16, int32_t *high_q16);

#endif
