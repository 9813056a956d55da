#include "core/creep.h"

#include "core/fixed.h"

#define LIMIT_Q40 ((int64_t)1 << 56)
#define HALF_Q30 (1 << 29)
#define ALPHA_MOST_Q64 ((int64_t)1 << 62)

bool creep_is_usable(const struct creep_config *config)
{
    int64_t sum_q30 = 0;
    for (unsigned i = 0; i < CREEP_TERMS; i++) {
        sum_q30 += config->k_q30[i] < 0 ? -(int64_t)config->k_q30[i] : config->k_q30[i];
        if (config->alpha_q64[i] < 0 || config->alpha_q64[i] > ALPHA_MOST_Q64)
            return false;
    }
    return sum_q30 <= HALF_Q30;
}

static int64_t bounded(int64_t value_q40)
{
    bool beyond = false;
    return sat_between_i64(value_q40, -LIMIT_Q40, LIMIT_Q40, &beyond);
}

void creep_admit(struct creep_state *state)
{
    for (unsigned i = 0; i < CREEP_TERMS; i++)
        state->lag_q40[i] = bounded(state->lag_q40[i]);
}

int64_t creep_undo_q40(const struct creep_config *config, const struct creep_state *state, int64_t x_q40)
{
    int64_t high_q38 = 0, low_q70 = 0; /* of the exact sum of all products, q70 */
    for (unsigned i = 0; i < CREEP_TERMS; i++) {
        int64_t lag_q40 = state->lag_q40[i];
        int32_t k_q30 = config->k_q30[i];
        if (k_q30 != 0) {
            high_q38 += (int64_t)signed_high_i64(lag_q40) * k_q30;
            low_q70 += (int64_t)signed_low_i64(lag_q40) * k_q30;
        }
    }
    return bounded(x_q40 - high_q38 * 4 - round_shift_i64(low_q70, 30));
}

void creep_follow(const struct creep_config *config, struct creep_state *state, int64_t d_q40)
{
    for (unsigned i = 0; i < CREEP_TERMS; i++)
        if (config->k_q30[i] != 0)
            state->lag_q40[i] += mul_shift64_i64(d_q40 - state->lag_q40[i], config->alpha_q64[i]);
}
