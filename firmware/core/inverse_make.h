/* From a model's numbers to the configuration of the inverse, when a model is committed; and how far it reaches. Never
 * in a tick.
 */
#ifndef PHASELEAD_CORE_INVERSE_MAKE_H
#define PHASELEAD_CORE_INVERSE_MAKE_H

#include "core/inverse.h"

enum inverse_verdict {
    INVERSE_EXISTS,
    INVERSE_REST_BEYOND_THRESHOLDS,
    INVERSE_PLAYS_OUT_OF_ORDER, /* or a threshold too large */
    INVERSE_WEIGHT_NEGATIVE,
    INVERSE_KNOTS_OUT_OF_ORDER,
    INVERSE_TOO_STEEP, /* all slopes together reach 1024 um/V */
    INVERSE_FALLS,     /* somewhere within the limits the position rises by less than 2^-10 um/V after a turn */
};

/* Checks the configuration and works out its made members, from the plays' weights (um/V, not negative); usable when
 * the inverse exists. */
enum inverse_verdict inverse_make(struct inverse_config *config, const int32_t play_w_q20[INVERSE_PLAYS]);

/* Positions that can be reached whatever the memory: from all plays drawn down to u_min to all pushed up to u_max. */
void inverse_reach_q16(const struct inverse_config *config, int32_t *low_q16, int32_t *high_q16);

/* 1 / mean slope of a voltage that goes back and forth by this share, 0 to 1, of the way between the limits. */
int32_t inverse_per_um_q28(const struct inverse_config *config, int32_t share_q28);

#endif
