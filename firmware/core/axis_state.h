/* What an axis is told, what it knows of its stage, and what it is doing (axis.h). */
#ifndef PHASELEAD_CORE_AXIS_STATE_H
#define PHASELEAD_CORE_AXIS_STATE_H

#include <stddef.h>

#include "core/axis_mode.h"
#include "core/compensation.h"
#include "core/converter.h"
#include "core/feedforward.h"
#include "core/loop_filter.h"
#include "core/oscillation.h"
#include "core/output.h"
#include "core/path.h"
#include "core/pid.h"
#include "core/segment.h"
#include "core/watch.h"

/* What the supervisor makes the axis do. */
enum axis_drive { DRIVE_HOLD, DRIVE_PATH, DRIVE_RAMP };

struct axis_config { /* fixed-size fields, explicit padding: read back as it lies in memory */
    uint32_t mode;   /* enum axis_mode */
    int32_t u_park_q24;
    int32_t ramp_q24;
    int32_t error_limit_q16; /* under feedback, um: further off for error_ticks is a fault */
    struct pid_config pid;
    struct path_config path;        /* that it follows, or is to */
    struct feedforward_point point; /* tables at the path's range and frequency, looked up when the path was set */
    struct output_config output;
    struct converter_config converter;
    uint32_t error_ticks;
    uint32_t code_min, code_max;   /* of the sensor: outside of them an axis that follows a path is a fault */
    int32_t oscillation_limit_q16; /* under feedback, um rms above the loop's band: from here on it matters */
    struct loop_filter_config filter;
    uint64_t enter_turn64, leave_turn64; /* of `path`, as in struct segment */
    uint32_t enter_ticks, leave_ticks;
    int32_t window_q16;    /* on target: no further off than this */
    uint32_t window_ticks; /* for so long in a row */
};

struct axis_model {                          /* what came with the stage model and the path; each may be NULL */
    const struct feedforward_tables *tables; /* used for holds and moves under table feed-forward */
    const struct compensation *compensation; /* modes inverse and inverse+pid */
    const int32_t *wave_q30;                 /* PATH_WAVE */
};

enum axis_target_flag {
    TARGET_READY = 1,        /* worked out for the next tick; without it the axis holds */
    TARGET_FOLLOWS_PATH = 2, /* the path decides the output */
    TARGET_FEEDBACK = 4,     /* with feedback */
    TARGET_INVERSE = 8,      /* with feed-forward by the inverse */
    TARGET_SATURATED = 16,
    TARGET_PATH_DONE = 32, /* the path ends in that tick */
    TARGET_LIMITED = 64    /* the feed-forward changes as fast as the output may, and should change faster */
};

/* What the path asks for in the next tick. */
struct axis_target {
    int32_t reference; /* um q16, or V q24 in mode open; kept when the axis no longer follows its path */
    int32_t ahead_q16; /* TARGET_INVERSE: where the axis should be one preview later, from its rest */
    int32_t feedforward_q24;
    uint32_t flags; /* enum axis_target_flag */
};

struct axis_state {
    struct path_state path;
    struct axis_target target;
    struct pid_state pid;
    struct compensation_state compensation;
    int32_t u_q24;        /* output of the last tick */
    uint32_t drive;       /* enum axis_drive */
    uint32_t saturations; /* ticks in which at least one block saturated */
    struct watch_state watch;
    struct join_state join;
    uint32_t near_ticks; /* in a row within the window; saturates */
    struct oscillation_state oscillation;
    struct loop_filter_state filter;
};

/* Both are copied byte for byte between 32- and 64-bit builds, so neither may contain padding of the compiler's. */
_Static_assert(sizeof(struct axis_config) == 192 && offsetof(struct axis_config, path) == 32, "axis_config is padded");
_Static_assert(sizeof(struct axis_state) == 872 && offsetof(struct axis_state, join) == 592, "axis_state is padded");

#endif
