/* inverse_check() and inverse_reach_q16(): when a model is committed or a path set. Never called in a tick. */
#include "core/fixed.h"
#include "core/inverse.h"

#define ONE_Q30 (1 << 30)
#define SLOPE_LEAST_Q20 (1 << 10)          /* 2^-10 um/V */
#define SLOPES_MOST_Q20 ((int64_t)1 << 30) /* with voltages of 2^32 LSB: positions below 2^62 */

/* Smallest slope on the way from u_min to u_max that no play helps, that is right after a turn. */
static bool rises_everywhere(const struct inverse_config *config)
{
    int64_t slope_q20 = config->gain_q20, least_q20 = INT64_MAX;
    int32_t from_q24 = config->u_min_q24;
    for (unsigned j = 0; j < INVERSE_KNOTS; j++) {
        int32_t d_q24 = config->knot_d_q24[j];
        if (d_q24 > from_q24 && from_q24 < config->u_max_q24) {
            least_q20 = slope_q20 < least_q20 ? slope_q20 : least_q20;
            from_q24 = d_q24;
        }
        slope_q20 += config->knot_s_q20[j];
    }
    if (from_q24 < config->u_max_q24 && slope_q20 < least_q20)
        least_q20 = slope_q20;
    return least_q20 >= SLOPE_LEAST_Q20;
}

static bool never_falls(const int32_t *values, unsigned count)
{
    for (unsigned i = 1; i < count; i++)
        if (values[i] < values[i - 1])
            return false;
    return true;
}

static int64_t sum_of_sizes(const int32_t *values, unsigned count)
{
    int64_t sum = 0;
    for (unsigned i = 0; i < count; i++)
        sum += (int64_t)magnitude_i64(values[i]);
    return sum;
}

enum inverse_verdict inverse_check(const struct inverse_config *config)
{
    if (config->rest_fraction_q30 < -ONE_Q30 || config->rest_fraction_q30 > ONE_Q30)
        return INVERSE_REST_BEYOND_THRESHOLDS;
    if (config->play_r_q24[0] < 0 || !never_falls(config->play_r_q24, INVERSE_PLAYS))
        return INVERSE_PLAYS_OUT_OF_ORDER;
    for (unsigned i = 0; i < INVERSE_PLAYS; i++)
        if (config->play_w_q20[i] < 0)
            return INVERSE_WEIGHT_NEGATIVE;
    if (!never_falls(config->knot_d_q24, INVERSE_KNOTS))
        return INVERSE_KNOTS_OUT_OF_ORDER;
    int64_t slopes_q20 = (int64_t)magnitude_i64(config->gain_q20) + sum_of_sizes(config->play_w_q20, INVERSE_PLAYS) +
                         sum_of_sizes(config->knot_s_q20, INVERSE_KNOTS);
    if (slopes_q20 >= SLOPES_MOST_Q20)
        return INVERSE_TOO_STEEP;
    return rises_everywhere(config) ? INVERSE_EXISTS : INVERSE_FALLS;
}

void inverse_reach_q16(const struct inverse_config *config, int32_t *low_q16, int32_t *high_q16)
{
    bool saturated = false;
    struct inverse_state state = {0};
    for (unsigned i = 0; i < INVERSE_PLAYS; i++)
        state.play_q24[i] = (int32_t)sat_between_i64((int64_t)config->u_min_q24 + config->play_r_q24[i], INT32_MIN,
                                                     INT32_MAX, &saturated);
    state.v_q24 = config->u_min_q24;
    *low_q16 = sat_i32(round_shift_i64(inverse_position_q44(config, &state), 28), &saturated);
    for (unsigned i = 0; i < INVERSE_PLAYS; i++)
        state.play_q24[i] = (int32_t)sat_between_i64((int64_t)config->u_max_q24 - config->play_r_q24[i], INT32_MIN,
                                                     INT32_MAX, &saturated);
    state.v_q24 = config->u_max_q24;
    *high_q16 = sat_i32(round_shift_i64(inverse_position_q44(config, &state), 28), &saturated);
}
