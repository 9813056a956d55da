/* One axis, one tick: reference -> look-ahead -> feed-forward -> feedback -> limit -> DAC code. Pure: everything it
 * needs is in its arguments.
 *
 * Reference, look-ahead and feed-forward do not depend on the sample. So they are worked out in advance, after the
 * output of the tick before: axis_set_target() and, with the inverse, axis_invert(). With the sample come
 * axis_error_q16() and axis_step(), after the output axis_follow_output(). In between, the positions ahead and the
 * errors of all axes may be decoupled (decouple.h). */
#ifndef PHASELEAD_CORE_AXIS_H
#define PHASELEAD_CORE_AXIS_H

#include <stddef.h>

#include "core/axis_mode.h"
#include "core/compensation.h"
#include "core/converter.h"
#include "core/feedforward.h"
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
    uint32_t padding;
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
    TARGET_PATH_DONE = 32 /* the path ends in that tick */
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
    uint32_t reserved;
    struct oscillation_state oscillation;
};

/* Both are copied byte for byte between 32- and 64-bit builds, so neither may contain padding of the compiler's. */
_Static_assert(sizeof(struct axis_config) == 152 && offsetof(struct axis_config, path) == 32, "axis_config is padded");
_Static_assert(sizeof(struct axis_state) == 824 && offsetof(struct axis_state, join) == 592, "axis_state is padded");

struct axis_trace { /* what a tick did, for the recorder */
    int32_t reference;
    int32_t feedforward_q24, feedback_q24;
    uint16_t dac_code;
    bool path_done; /* the path ended in this tick */
    bool inverted;  /* the inverse made the feed-forward */
    bool limited;   /* slew limit or clamp cut the output */
};

/* The axis begins its path in the next tick (drive becomes DRIVE_PATH), without a bump in its output: the integrator is
 * set so that the loop carries on from u_q24; the slew limit spreads what feed-forward alone would jump. */
void axis_start(struct axis_state *state);

/* For an axis just started: it enters its path from where it stands, if the path has a join or begins here. The output
 * stays, the reference begins at the position; from there on they join the path, which begins `enter_ticks` later, at
 * least axis_enter_ticks(). */
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

/* For an axis that was given a path and does not follow it yet: its reference becomes the path's first value. */
void axis_set_reference(const struct axis_config *config, const struct axis_model *model, struct axis_state *state);

/* It follows its path, and the target of the next tick is not known yet. */
bool axis_needs_target(const struct axis_state *state);

/* Reference, look-ahead and feed-forward of the next tick; advances the path. For an axis that needs a target. True:
 * axis_invert() must follow and gives the feed-forward. */
bool axis_set_target(const struct axis_config *config, const struct axis_model *model, struct axis_state *state);

/* Feed-forward by the inverse: the voltage for target.ahead_q16, decoupled. */
void axis_invert(const struct axis_model *model, struct axis_state *state, int32_t ahead_q16);

/* This tick has feedback. */
bool axis_has_feedback(const struct axis_state *state);

/* Reference - position, for an axis with feedback. */
int32_t axis_error_q16(const struct axis_config *config, struct axis_state *state, uint16_t adc_code);

/* Feedback, limit and DAC code. The target is used up. True: the axis is at rest, another step would change nothing. */
bool axis_step(const struct axis_config *config, struct axis_state *state, int32_t error_q16, struct axis_trace *trace);

/* After the output, for an axis under feedback: whether it can still be believed. `error_q16` as axis_step() had it. */
enum watch_finding axis_watch(const struct axis_config *config, struct axis_state *state, uint16_t adc_code,
                              int32_t error_q16, const struct axis_trace *trace);

/* After the output, for an axis that follows its path in any mode: whether it is within the range it is held to. */
bool axis_watch_range(const struct axis_config *config, struct axis_state *state, uint16_t adc_code);

/* Counts the ticks in a row that the position has been within the window of the reference. */
void axis_watch_target(const struct axis_config *config, struct axis_state *state, uint16_t adc_code,
                       const struct axis_trace *trace);
bool axis_is_on_target(const struct axis_config *config, const struct axis_state *state);

/* Lets the memory of the inverse follow an output that the inverse did not make. True when the memory keeps changing
 * while the output stands still (creep). */
bool axis_follow_output(const struct axis_model *model, struct axis_state *state, const struct axis_trace *trace);

#endif
