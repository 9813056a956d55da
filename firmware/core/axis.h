/* One axis, one tick: reference -> feed-forward + PID -> limits -> DAC code. Pure: everything it needs is in its
 * arguments. */
#ifndef PHASELEAD_CORE_AXIS_H
#define PHASELEAD_CORE_AXIS_H

#include <stddef.h>

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

struct axis_state {
    struct path_state path;
    struct pid_state pid;
    int32_t u_q24;        /* output of the last tick */
    uint32_t drive;       /* enum axis_drive */
    uint32_t saturations; /* ticks in which at least one block saturated */
    uint32_t rail_ticks;  /* consecutive ticks with the ADC at a rail */
};

/* Both travel byte for byte between 32- and 64-bit builds, so neither may hold padding a compiler chose. */
_Static_assert(sizeof(struct axis_config) == 104 && offsetof(struct axis_config, path) == 32, "axis_config is padded");
_Static_assert(sizeof(struct axis_state) == 72 && offsetof(struct axis_state, u_q24) == 56, "axis_state is padded");

struct axis_trace { /* what a tick did, for the recorder */
    int32_t reference;
    int32_t feedforward_q24, feedback_q24;
    uint16_t adc_code, dac_code;
    bool path_done; /* the path ended in this tick */
};

/* The axis begins its path in the next tick (drive becomes DRIVE_PATH), without a bump in its output: the integrator is
 * set so that the loop carries on from u_q24; the slew limit spreads what feed-forward alone would jump. */
void axis_start(const struct axis_config *config, struct axis_state *state);

/* `tables` is used for holds and moves under feed-forward and may be NULL otherwise; `wave_q30` only for PATH_WAVE. */
void axis_step(const struct axis_config *config, const struct feedforward_tables *tables, const int32_t *wave_q30,
               struct axis_state *state, uint16_t adc_code, struct axis_trace *trace);

#endif
