/* PID on the position error (Xu & Li 2010, eq. 13), error = reference - position, output in volts.
 *
 * u = Kp e + sum(Ki Ts e) + D, D = alpha-filtered Kd/Ts (e - e_previous); alpha 0x7fffffff means unfiltered, exactly.
 * With the paper's gains the derivative must stay unfiltered (or filtered well above 2 kHz), or the loop is unstable.
 *
 * Exact in its sums: the integrator and the unfiltered derivative are whole products, the filtered derivative moves
 * within 1 LSB of q40 per tick of the exact recursion, and the output is within 0.51 LSB of q24 of the sum of the
 * three, as long as nothing saturates. The integrator saturates at the +-128 V that q24 holds.
 */
#ifndef PHASELEAD_CORE_PID_H
#define PHASELEAD_CORE_PID_H

#include <stdbool.h>
#include <stdint.h>

#define PID_DERIVATIVE_UNFILTERED INT32_MAX

struct pid_config {
    int32_t kp_q24;         /* V/um */
    int32_t ki_ts_q32;      /* V/um per tick */
    int32_t kd_over_ts_q24; /* V/um */
    int32_t d_alpha_q31;    /* 0 .. 0x7fffffff */
};

struct pid_state {
    int64_t integral_q48;      /* V */
    int64_t integral_step_q48; /* V: what this tick's integration added */
    int64_t derivative_q40;    /* V */
    int32_t error_q16;         /* of the tick before */
    uint32_t primed;           /* 0 until the preset that goes before the first step */
};

void pid_reset(struct pid_state *state);

/* Output of this tick, behind a preset. The integrator is advanced by this tick's error (backward rectangle, as eq.
 * 13). */
int32_t pid_step_q24(const struct pid_config *config, struct pid_state *state, int32_t error_q16, bool *saturated);

/* Anti-windup that sees the final slew limit and clamp: `cut_q24` = limited - wanted output of this tick. When the
 * output was cut and this tick's integration pushed further into the cut, that integration is taken back.
 * Once a step. */
void pid_unwind(struct pid_state *state, int64_t cut_q24);

/* Bumpless start of a state as reset leaves it: sets the integrator so that feedforward + P + I equals `output_q24` for
 * this error. */
void pid_preset(const struct pid_config *config, struct pid_state *state, int32_t error_q16, int32_t output_q24,
                int32_t feedforward_q24);

/* Other gains from the next step on: the integrator takes over what P changes by, so that the output goes on. */
void pid_exchange(const struct pid_config *before, const struct pid_config *after, struct pid_state *state);

#endif
