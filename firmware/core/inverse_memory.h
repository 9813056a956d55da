/* What the memory of the operator says: where plays stand, which position that makes, and the memory at rest. Not for
 * the tick.
 */
#ifndef PHASELEAD_CORE_INVERSE_MEMORY_H
#define PHASELEAD_CORE_INVERSE_MEMORY_H

#include "core/extremes.h"
#include "core/inverse.h"

/* The memory of a stage at rest at 0 V that begins to follow v. Short enough for a moment without ticks. */
void inverse_rest(const struct inverse_config *config, struct inverse_state *state, int32_t v_q24);

/* The memory of this operator after what another one, `before`, remembers by `old`, and then v: the same where both
 * have the same thresholds. Long: not for a moment without ticks. */
void inverse_recall(const struct inverse_config *config, struct inverse_state *state,
                    const struct inverse_config *before, const struct inverse_state *old, int32_t v_q24);

/* The memory of a stage that rested at 0 V, went as far as `extremes`, and then to v: turns between the two are left
 * out. Long: not for a moment without ticks. */
void inverse_begin_after(const struct inverse_config *config, struct inverse_state *state,
                         const struct extremes *extremes, int32_t v_q24);

/* A state that came from elsewhere may hold anything: one that is no memory of this operator becomes that of a stage at
 * rest. */
void inverse_admit(const struct inverse_config *config, struct inverse_state *state);

/* Where a play stands. */
int64_t inverse_play_q24(const struct inverse_config *config, const struct inverse_state *state, unsigned play);

/* What a play that stands there adds to the position, and what all of them add. */
int64_t inverse_weighted_q44(const struct inverse_config *config, unsigned play, int64_t play_q24);
int64_t inverse_plays_q44(const struct inverse_config *config, const struct inverse_state *state);

/* Position without plays at a voltage, how many knots lie at or below it, and the slope above it. */
int64_t inverse_curve_q44(const struct inverse_config *config, int32_t v_q24, uint32_t *knots, int32_t *slope_q20);

#endif
