#include "core/creep.h"

#include "core/fixed.h"

#define LIMIT_Q40 ((int64_t)1 << 56)
#define HALF_Q30 (1 << 29)
#define ONE_Q48 ((int64_t)1 << 48)

bool creep_is_usable(const struct creep_config *config)
{
    int64_t sum_q30 = 0;
    for (unsigned i = 0; i < CREEP_TERMS; i++) {
        sum_q30 += config->k_q30[i] < 0 ? -(int64_t)config->k_q30[i] : config->k_q30[i];
        if (config->alpha_q48[i] < 0 || config->alpha_q48[i] > ONE_Q48)
            return false;
    }
    return sum_q30 <= HALF_Q30;
}

/* A state that was read back from elsewhere may hold anything. */
static int64_t bounded(int64_t value_q40)
{
    bool beyond = false;
    return sat_between_i64(value_q40, -LIMIT_Q40, LIMIT_Q40, &beyond);
}

int64_t creep_undo_q40(const struct creep_config *config, const struct creep_state *state, int64_t x_q40)
{
    int64_t d_q40 = bounded(x_q40);
    for (unsigned i = 0; i < CREEP_TERMS; i++)
        if (config->k_q30[i] != 0)
            d_q40 -= mul_shift_i64_i32(bounded(state->lag_q40[i]), config->k_q30[i], 30);
    return bounded(d_q40);
}

void creep_follow(const struct creep_config *config, struct creep_state *state, int64_t d_q40)
{
    bool beyond = false;
    for (unsigned i = 0; i < CREEP_TERMS; i++)
        if (config->k_q30[i] != 0) {
            int64_t lag_q40 = bounded(state->lag_q40[i]);
            state->lag_q40[i] = lag_q40 + mul_shift_i64(bounded(d_q40) - lag_q40, config->alpha_q48[i], 48, &beyond);
        }
}
