/* One axis, one tick: reference -> look-ahead -> feed-forward -> feedback -> limit -> DAC code. Pure: everything it
 * needs is in its arguments.
 *
 * The first three do not hang on the sample, so they are found before it, and little lies between sample and output:
 * axis_set_target() and, when the inverse is at work, axis_invert(), behind the output of the tick before. With the
 * sample come axis_error_q16() and axis_step(), and behind the output axis_follow_output(). Positions ahead of all
 * axes, and their errors, may be decoupled (decouple.h) in between. */
#ifndef PHASELEAD_CORE_AXIS_H
#define PHASELEAD_CORE_AXIS_H

#include <stddef.h>

#include "core/axis_mode.h"
#include "core/compensation.h"
#include "core/converter.h"
#include "core/feedforward.h"
#include "core/output.h"
#include "core/path.h"
#include "core/pid.h"

/* What the axis is being made to do by the supervisor. */
enum axis_drive { DRIVE_HOLD, DRIVE_PATH, DRIVE_RAMP };

struct axis_config { /* fixed-size fields, explicit padding: read back as it lies in memory */
    uint32_t mode;   /* enum axis_mode */
    int32_t u_park_q24;
    int32_t ramp_q24;
    uint32_t reserved;
    struct pid_config pid;
    struct path_config path;
    struct feedforward_point point; /* tables at the path's range and frequency, looked up when the path was set */
    struct output_config output;
    struct converter_config converter;
    uint32_t reserved2;
};

struct axis_model {                          /* what came with the stage model and the path; each may be NULL */
    const struct feedforward_tables *tables; /* used for holds and moves under table feed-forward */
    const struct compensation *compensation; /* modes inverse and inverse+pid */
    const int32_t *wave_q30;                 /* PATH_WAVE */
};

enum axis_target_flag {
    TARGET_READY = 1,        /* found for the tick to come; without it the axis holds */
    TARGET_FOLLOWS_PATH = 2, /* the path decides the output */
    TARGET_FEEDBACK = 4,     /* feedback is at work */
    TARGET_INVERSE = 8,      /* the inverse is */
    TARGET_SATURATED = 16,
    TARGET_PATH_DONE = 32 /* the path ends in that tick */
};

/* What the path asks for in the tick to come. */
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
    uint32_t rail_ticks;  /* consecutive ticks on the path with the ADC at a rail */
};

/* Both travel byte for byte between 32- and 64-bit builds, so neither may hold padding a compiler chose. */
_Static_assert(sizeof(struct axis_config) == 104 && offsetof(struct axis_config, path) == 32, "axis_config is padded");
_Static_assert(sizeof(struct axis_state) == 552 && offsetof(struct axis_state, u_q24) == 536, "axis_state is padded");

struct axis_trace { /* what a tick did, for the recorder */
    int32_t reference;
    int32_t feedforward_q24, feedback_q24;
    uint16_t dac_code;
    bool path_done; /* the path ended in this tick */
    bool inverted;  /* the inverse made the feed-forward */
};

/* The axis begins its path in the next tick (drive becomes DRIVE_PATH), without a bump in its output: the integrator is
 * set so that the loop carries on from u_q24; the slew limit spreads what feed-forward alone would jump. */
void axis_start(struct axis_state *state);

/* The axis was given a path that it does not follow yet: its reference is where that begins. */
void axis_set_reference(const struct axis_config *config, const struct axis_model *model, struct axis_state *state);

/* It follows its path, and the target of the tick to come is not known yet. */
bool axis_needs_target(const struct axis_state *state);

/* Reference, look-ahead and feed-forward of the tick to come; the path goes on. For an axis that needs it. True: the
 * feed-forward is still to come from axis_invert(). */
bool axis_set_target(const struct axis_config *config, const struct axis_model *model, struct axis_state *state);

/* Feed-forward by the inverse: the voltage for target.ahead_q16, decoupled. */
void axis_invert(const struct axis_model *model, struct axis_state *state, int32_t ahead_q16);

/* Feedback is at work in this tick. */
bool axis_has_feedback(const struct axis_state *state);

/* Reference - position, for an axis with feedback. */
int32_t axis_error_q16(const struct axis_config *config, struct axis_state *state, uint16_t adc_code);

/* Feedback, limit and DAC code. The target is used up. True: the axis is at rest, another step would change nothing. */
bool axis_step(const struct axis_config *config, struct axis_state *state, uint16_t adc_code, int32_t error_q16,
               struct axis_trace *trace);

/* The memory of an inverse that did not make the output goes along with it. True when it goes on even with an output
 * that stands still: creep. */
bool axis_follow_output(const struct axis_model *model, struct axis_state *state, const struct axis_trace *trace);

#endif
