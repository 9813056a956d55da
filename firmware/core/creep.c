#include "core/creep.h"

#include "core/fixed.h"

#define LIMIT_BITS_Q40 56
#define HALF_Q30 (1 << 29)
#define ALPHA_MOST_Q64 ((int64_t)1 << 62)

bool creep_make(struct creep_config *config)
{
    uint64_t sum_q30 = 0;
    config->in_use = 0;
    for (unsigned i = 0; i < CREEP_TERMS; i++) {
        sum_q30 += magnitude_i64(config->k_q30[i]);
        if (config->alpha_q64[i] < 0 || config->alpha_q64[i] > ALPHA_MOST_Q64)
            return false;
        if (config->k_q30[i] != 0)
            config->in_use = 1;
    }
    return sum_q30 <= HALF_Q30;
}

bool creep_is_in_use(const struct creep_config *config)
{
    return config->in_use != 0;
}

static int64_t bounded(int64_t value_q40)
{
    bool beyond = false;
    return sat_power_i64(value_q40, LIMIT_BITS_Q40, &beyond);
}

void creep_admit(struct creep_state *state)
{
    for (unsigned i = 0; i < CREEP_TERMS; i++)
        state->lag_q40[i] = bounded(state->lag_q40[i]);
}

int64_t creep_undo_q40(const struct creep_config *config, const struct creep_state *state, int64_t x_q40)
{
    /* sum k_i lag_i, exactly, as high x 2^32 + low: one product alone has 88 bits. */
    int64_t high_q38 = 0, low_q70 = 0;
    for (unsigned i = 0; i < CREEP_TERMS; i++) {
        high_q38 += (int64_t)signed_high_i64(state->lag_q40[i]) * config->k_q30[i];
        low_q70 += (int64_t)signed_low_i64(state->lag_q40[i]) * config->k_q30[i];
    }
    return bounded(x_q40 - high_q38 * 4 - round_shift_i64(low_q70, 30));
}

int64_t creep_so_far_q16(const struct creep_config *config, const struct creep_state *state)
{
    int64_t sum_q44 = 0; /* lags in q14 fit 32 bits; a start is short of cycles, and the flash of room */
#pragma GCC unroll 1
    for (unsigned i = 0; i < CREEP_TERMS; i++)
        sum_q44 += (int64_t)(int32_t)floor_shift_i64(state->lag_q40[i], 26) * config->k_q30[i];
    return round_shift_i64(sum_q44, 28);
}

void creep_follow(const struct creep_config *config, struct creep_state *state, int64_t d_q40)
{
    for (unsigned i = 0; i < CREEP_TERMS; i++)
        if (config->k_q30[i] != 0)
            state->lag_q40[i] = add_mul_shift64_i64(state->lag_q40[i], d_q40 - state->lag_q40[i], config->alpha_q64[i]);
}
