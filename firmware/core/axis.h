/* One axis, one tick: reference -> feed-forward + PID -> limits -> DAC code. Pure: everything it needs is in its
 * arguments.
 *
 * A tick has two halves. axis_aim() of every axis finds where it should be and how far off it is; between the halves
 * these may be decoupled (decouple.h); axis_step() of every axis makes an output of them. */
#ifndef PHASELEAD_CORE_AXIS_H
#define PHASELEAD_CORE_AXIS_H

#include <stddef.h>

#include "core/compensation.h"
#include "core/converter.h"
#include "core/feedforward.h"
#include "core/output.h"
#include "core/path.h"
#include "core/pid.h"

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

struct axis_state {
    struct path_state path;
    struct pid_state pid;
    struct compensation_state compensation;
    int32_t u_q24;        /* output of the last tick */
    uint32_t drive;       /* enum axis_drive */
    uint32_t saturations; /* ticks in which at least one block saturated */
    uint32_t rail_ticks;  /* consecutive ticks with the ADC at a rail */
};

/* Both travel byte for byte between 32- and 64-bit builds, so neither may hold padding a compiler chose. */
_Static_assert(sizeof(struct axis_config) == 104 && offsetof(struct axis_config, path) == 32, "axis_config is padded");
_Static_assert(sizeof(struct axis_state) == 496 && offsetof(struct axis_state, u_q24) == 480, "axis_state is padded");

struct axis_trace { /* what a tick did, for the recorder */
    int32_t reference;
    int32_t feedforward_q24, feedback_q24;
    uint16_t adc_code, dac_code;
    bool path_done; /* the path ended in this tick */
};

/* The axis begins its path in the next tick (drive becomes DRIVE_PATH), without a bump in its output: the integrator is
 * set so that the loop carries on from u_q24; the slew limit spreads what feed-forward alone would jump. */
void axis_start(const struct axis_config *config, struct axis_state *state);

struct axis_aim {
    int32_t reference; /* now: um q16, or V q24 in mode open */
    int32_t ahead_q16; /* inverts: where the axis should be one preview from now, from its rest */
    int32_t error_q16; /* closes: reference - position */
    bool inverts, closes;
    bool follows; /* the path decides the output */
    bool saturated;
};

void axis_aim(const struct axis_config *config, const struct axis_model *model, const struct axis_state *state,
              uint16_t adc_code, struct axis_aim *aim);

void axis_step(const struct axis_config *config, const struct axis_model *model, struct axis_state *state,
               const struct axis_aim *aim, uint16_t adc_code, struct axis_trace *trace);

/* Feedback is at work in this mode. */
bool axis_mode_closes(uint32_t mode);
/* The inverse is. */
bool axis_mode_inverts(uint32_t mode);
/* The tables are. */
bool axis_mode_uses_tables(uint32_t mode);

#endif
