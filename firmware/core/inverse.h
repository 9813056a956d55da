/* The inverse of the time view: the voltage v at which
 *
 *     x = offset + gain v + sum w_i play_ri[v] + sum s_j max(v - d_j, 0)      (Kuhnen 2003, eqs. 5, 8, 30)
 *
 * is a given position. From where the plays stand, x is a rising line with bends where a play begins to move and at
 * d_j: the inverse walks along it from the present voltage, bend by bend. That is exact: Krejci and Kuhnen's closed
 * form needs plays and dead zones in series, these are in parallel. A tick passes INVERSE_BENDS_A_TICK bends at most; a
 * jump over more of them (which the slew limit would spread anyway) is finished in the ticks that follow.
 *
 * The memory is not where each play stands but where the voltage turned. Plays are sorted by threshold, and a larger
 * one never moves without the smaller ones: those that move are the first `moving` ones. At a turn they stop together,
 * so one voltage tells where all of them stand, until the voltage comes back to it (they all move again) or is twice a
 * play's threshold away from it (that play moves the other way). When the voltage has come back to a turn, the loop is
 * closed and the turn is forgotten.
 *
 * x is an exact integer (q44), updated by every step that is walked; the voltage is the nearest q24, so that x is met
 * to half an LSB of the voltage times the slope.
 */
#ifndef PHASELEAD_CORE_INVERSE_H
#define PHASELEAD_CORE_INVERSE_H

#include <stdbool.h>
#include <stdint.h>

#define INVERSE_PLAYS 32
#define INVERSE_KNOTS 24
#define INVERSE_BENDS_A_TICK 3
#define INVERSE_UNUSED INT32_MAX              /* threshold of a place that is not in use */
#define INVERSE_THRESHOLD_MOST_Q24 (64 << 24) /* of a play in use: half the largest distance of two voltages */

struct inverse_play { /* all but r made by inverse_make() */
    int32_t r_q24;    /* threshold, in rising order; those not in use: INVERSE_UNUSED */
    int32_t sum_q20;  /* um/V, weights of all plays before it together */
    int32_t rest_q24; /* where it stands in a stage at rest */
};

struct inverse_config {
    int64_t rest_x_q44; /* of a stage at rest at 0 V; this and the next two made by inverse_make() */
    int32_t rest_slope_q20;
    uint32_t rest_knots;
    int32_t u_min_q24, u_max_q24; /* the inverse exists, and stays, within these */
    int32_t gain_q20;             /* um/V */
    int32_t offset_q16;
    int32_t rest_fraction_q30;
    uint32_t plays, knots; /* in use: made by inverse_make() */
    struct inverse_play play[INVERSE_PLAYS + 1];
    int32_t knot_d_q24[INVERSE_KNOTS]; /* in rising order; those not in use: INVERSE_UNUSED */
    int32_t knot_s_q20[INVERSE_KNOTS];
};

struct inverse_state {
    int64_t x_q44; /* where the stage stands by its memory */
    int32_t v_q24;
    int32_t slope_q20; /* without plays, above v */
    uint32_t knots;    /* how many were passed: those below v, and perhaps one at v */
    uint32_t rises;    /* 1: the voltage went up last, 0: down */
    uint32_t moving;   /* how many plays went with it */
    uint32_t turns;    /* bit i: play i, and those below it down to the next bit, stopped at turn_q24[i]. Plays above
                        * the highest bit have not moved since the stage was at rest */
    uint32_t risen;    /* bit i: the voltage had been rising to turn_q24[i] */
    int32_t turn_q24[INVERSE_PLAYS];
    uint32_t reserved; /* explicit padding */
};

/* Updates the memory for a voltage that goes straight to v, at most to the limit or to the last bend that this tick
 * has time for. */
void inverse_follow(const struct inverse_config *config, struct inverse_state *state, int32_t v_q24);

/* Goes to the voltage at which the position is x, and returns it. Where the limit, the most that the voltage may change
 * in a tick or the last bend of this tick comes first, it stops there and sets *saturated: so the memory turns no
 * further on than the output can have come. |x| < 2^15 um, most_q24 >= 0. */
int32_t inverse_step_q24(const struct inverse_config *config, struct inverse_state *state, int64_t x_q44,
                         int32_t most_q24, bool *saturated);

#endif
