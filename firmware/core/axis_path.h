/* What an axis' paths ask for in a tick, and how it passes from one to the next (segment.h). */
#ifndef PHASELEAD_CORE_AXIS_PATH_H
#define PHASELEAD_CORE_AXIS_PATH_H

#include "core/axis_state.h"

struct axis_wanted {
    int32_t reference;       /* um q16, or V q24 in mode open */
    int32_t ahead_q16;       /* inverse modes: the position one preview later */
    int32_t feedforward_q24; /* modes open, ff and ff+pid; in inverse modes it comes from ahead_q16 */
};

/* `follows`: the path decides the output, so that more than the reference is needed. */
struct axis_wanted axis_wanted(const struct axis_config *config, const struct axis_model *model,
                               const struct axis_state *state, bool follows, bool *saturated);

/* One tick on. True at the tick in which the path ends. */
bool axis_path_advance(const struct axis_config *config, struct axis_state *state);

/* For an axis just started: it enters its path from where it stands, if the path has a join or begins here. The output
 * stays, the reference begins at the position; from there on they join the path, which begins `enter_ticks` later, at
 * least axis_enter_ticks(). join.ahead_q16 is where it stands by its own memory, whether it has a join or not: of
 * coupled axes the caller makes it what is seen. */
void axis_enter(struct axis_config *config, const struct axis_model *model, struct axis_state *state, uint16_t adc_code,
                uint32_t enter_ticks);
uint32_t axis_enter_ticks(const struct axis_config *config, const struct axis_model *model);

/* It leaves its path for the next one, which begins `wait_ticks` later, at least axis_wait_ticks(): how far the mode
 * looks ahead. Between two ticks, and only when no join is under way. */
void axis_begin(struct axis_config *config, const struct axis_model *model, struct axis_state *state,
                const struct segment *segment, uint32_t wait_ticks);
uint32_t axis_wait_ticks(const struct axis_config *config, const struct axis_model *model);

/* Its path has ended, or is one without an end. */
bool axis_path_is_over(const struct axis_config *config, const struct axis_state *state);

/* A periodic path has ended: joins it to a hold where it ends, if it has a join for that. True when it did. */
bool axis_leave(struct axis_config *config, const struct axis_model *model, struct axis_state *state);

#endif
