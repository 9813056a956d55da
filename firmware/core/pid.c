#include "core/pid.h"

#include "core/fixed.h"

#define INTEGRAL_BITS_Q40 47u /* 128 V: what the output can hold */
#define INTEGRAL_BITS_Q48 55u
#define DERIVATIVE_BITS_Q40 61u /* leaves room to add P, at most 2^62, in 64 bits */

void pid_reset(struct pid_state *state)
{
    *state = (struct pid_state){0};
}

/* value + alpha (target - value), |value|, |target| <= 2^61. The product of the difference with alpha has 94 bits. */
static int64_t low_pass_q40(int64_t value_q40, int64_t target_q40, int32_t alpha_q31)
{
    int64_t difference_q40 = target_q40 - value_q40;
    int64_t low_q71 = (int64_t)alpha_q31 * signed_low_i64(difference_q40);
    int64_t high_q39 = (int64_t)alpha_q31 * signed_high_i64(difference_q40);
    return value_q40 + 2 * high_q39 + round_shift_i64(low_q71, 31);
}

static int64_t derivative_q40(const struct pid_config *config, struct pid_state *state, int32_t error_q16,
                              bool *saturated)
{
    int32_t change_q16 = sub_i32(error_q16, state->error_q16); /* beyond what a sensor can do it saturates */
    int64_t raw_q40 = sat_power_i64((int64_t)config->kd_over_ts_q24 * change_q16, DERIVATIVE_BITS_Q40, saturated);
    if (config->d_alpha_q31 == PID_DERIVATIVE_UNFILTERED)
        return raw_q40;
    return sat_power_i64(low_pass_q40(state->derivative_q40, raw_q40, config->d_alpha_q31), DERIVATIVE_BITS_Q40,
                         saturated);
}

int32_t pid_step_q24(const struct pid_config *config, struct pid_state *state, int32_t error_q16, bool *saturated)
{
    state->derivative_q40 = derivative_q40(config, state, error_q16, saturated);
    state->error_q16 = error_q16;

    int64_t before_q48 = state->integral_q48;
    state->integral_q48 =
        sat_power_i64(before_q48 + (int64_t)config->ki_ts_q32 * error_q16, INTEGRAL_BITS_Q48, saturated);
    state->integral_step_q48 = state->integral_q48 - before_q48;

    int64_t proportional_q40 = (int64_t)config->kp_q24 * error_q16;
    int64_t sum_q40 = proportional_q40 + state->derivative_q40 + floor_shift_i64(state->integral_q48, 8);
    return sat_i32(round_shift_i64(sum_q40, 16), saturated); /* below 2^63 whatever the parts */
}

void pid_unwind(struct pid_state *state, int64_t cut_q24)
{
    const int64_t step_q48 = state->integral_step_q48;
    const bool deeper = (cut_q24 < 0 && step_q48 > 0) || (cut_q24 > 0 && step_q48 < 0);
    if (deeper)
        state->integral_q48 -= step_q48;
}

void pid_preset(const struct pid_config *config, struct pid_state *state, int32_t error_q16, int32_t output_q24,
                int32_t feedforward_q24)
{
    bool beyond = false; /* an integral that does not fit leaves a bump, which the slew limit spreads */
    int64_t wanted_q40 = ((int64_t)output_q24 - feedforward_q24) * 65536 - (int64_t)config->kp_q24 * error_q16;
    state->integral_q48 = 256 * sat_power_i64(wanted_q40, INTEGRAL_BITS_Q40, &beyond);
    state->integral_step_q48 = 0;
    state->error_q16 = error_q16;
    state->primed = 1;
}

void pid_exchange(const struct pid_config *before, const struct pid_config *after, struct pid_state *state)
{
    bool beyond = false; /* leaves a bump, which the slew limit spreads */
    if (state->primed == 0)
        return;
    const int64_t change_q40 = ((int64_t)before->kp_q24 - after->kp_q24) * state->error_q16;
    const int64_t change_q48 = 256 * sat_power_i64(change_q40, INTEGRAL_BITS_Q40, &beyond);
    state->integral_q48 = sat_power_i64(state->integral_q48 + change_q48, INTEGRAL_BITS_Q48, &beyond);
}
