/* One axis, one tick: reference -> feed-forward + PID -> limits -> DAC code. Pure: everything it needs is in its
 * arguments.
 *
 * What does not hang on the sample is found before it, so that little lies between sample and output: axis_aim() and
 * axis_feed() at the start, and then once the output of the tick before is out; with the sample axis_error_q16() and
 * axis_step(); then axis_settle(). What all axes want, and their errors, may be decoupled
 * (decouple.h) in between. */
#ifndef PHASELEAD_CORE_AXIS_H
#define PHASELEAD_CORE_AXIS_H

#include <stddef.h>

#include "core/compensation.h"
#include "core/converter.h"
#include "core/feedforward.h"
#include "core/output.h"
#include "core/path.h"
#include "core/pid.h"

/* Three axes are passed over one by one: what is called for those that move costs the others nothing. */
#define AXIS_CALLED __attribute__((noinline))

enum axis_mode { AXIS_IDLE, AXIS_OPEN, AXIS_PID, AXIS_FF, AXIS_FF_PID, AXIS_INVERSE, AXIS_INVERSE_PID };

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

enum axis_aim_flag {
    AIM_READY = 1,   /* found for the tick to come; without it the axis holds */
    AIM_FOLLOWS = 2, /* the path decides the output */
    AIM_CLOSES = 4,  /* feedback is at work */
    AIM_INVERTS = 8, /* the inverse is */
    AIM_SATURATED = 16,
    AIM_PATH_DONE = 32 /* the path ends in that tick */
};

struct axis_aim {
    int32_t reference; /* um q16, or V q24 in mode open; kept when the axis no longer follows its path */
    int32_t ahead_q16; /* AIM_INVERTS: where the axis should be one preview later, from its rest */
    int32_t feedforward_q24;
    uint32_t flags; /* enum axis_aim_flag */
};

struct axis_state {
    struct path_state path;
    struct axis_aim aim;
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
void axis_start(const struct axis_config *config, struct axis_state *state);

/* The axis was given a path that it does not follow yet: its reference is where that begins. */
void axis_set_reference(const struct axis_config *config, const struct axis_model *model, struct axis_state *state);

/* It follows its path and what it aims at is not known yet. */
static inline bool axis_needs_aim(const struct axis_state *state)
{
    return state->drive == DRIVE_PATH && (state->aim.flags & AIM_READY) == 0;
}

/* Where the path is in the tick to come; the path goes on. For an axis that needs it. True: AIM_INVERTS. */
AXIS_CALLED bool axis_aim(const struct axis_config *config, const struct axis_model *model, struct axis_state *state);

/* AIM_INVERTS: the voltage for `ahead`, which is aim.ahead_q16, decoupled. */
void axis_feed(const struct axis_model *model, struct axis_state *state, int32_t ahead_q16);

/* Feedback is at work in this tick. */
static inline bool axis_closes(const struct axis_state *state)
{
    return state->drive == DRIVE_PATH && (state->aim.flags & AIM_CLOSES) != 0;
}

/* Reference - position, for an axis that closes. */
int32_t axis_error_q16(const struct axis_config *config, struct axis_state *state, uint16_t adc_code);

/* The output. What was aimed at is used up. True: the axis is at rest, another step would change nothing. */
AXIS_CALLED bool axis_step(const struct axis_config *config, struct axis_state *state, uint16_t adc_code,
                           int32_t error_q16, struct axis_trace *trace);

/* Behind the output: the memory of an inverse that did not make it goes along. True when it goes on with an output that
 * stands still: creep. */
bool axis_settle(const struct axis_model *model, struct axis_state *state, const struct axis_trace *trace);

/* Feedback is at work in this mode. */
bool axis_mode_closes(uint32_t mode);
/* The inverse is. */
bool axis_mode_inverts(uint32_t mode);
/* The tables are. */
bool axis_mode_uses_tables(uint32_t mode);

#endif
