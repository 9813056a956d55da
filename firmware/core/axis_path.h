/* What an axis' paths ask for in a tick, and how it passes from one to the next (segment.h). Used by axis.h alone. */
#ifndef PHASELEAD_CORE_AXIS_PATH_H
#define PHASELEAD_CORE_AXIS_PATH_H

#include "core/axis.h"

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

#endif
