#include "core/inverse_make.h"

#include "core/fixed.h"
#include "core/inverse_memory.h"

#define ONE_Q30 (1 << 30)
#define SLOPE_LEAST_Q20 (1 << 10)          /* 2^-10 um/V */
#define SLOPES_MOST_Q20 ((int64_t)1 << 30) /* with voltages of 2^32 LSB: positions below 2^62 */

/* Whether the position rises from u_min to u_max even where no play moves, that is right after a turn. */
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

static bool plays_in_order(const struct inverse_play play[INVERSE_PLAYS])
{
    int32_t before_q24 = 0;
    for (unsigned i = 0; i < INVERSE_PLAYS; i++) {
        int32_t r_q24 = play[i].r_q24;
        if (r_q24 < before_q24 || (r_q24 > INVERSE_THRESHOLD_MOST_Q24 && r_q24 != INVERSE_UNUSED))
            return false;
        before_q24 = r_q24;
    }
    return true;
}

static int64_t sum_of_sizes(const int32_t *values, unsigned count)
{
    int64_t sum = 0;
    for (unsigned i = 0; i < count; i++)
        sum += (int64_t)magnitude_i64(values[i]);
    return sum;
}

static void count_used(struct inverse_config *config)
{
    config->plays = config->knots = 0;
    for (unsigned i = 0; i < INVERSE_PLAYS; i++)
        config->plays += config->play[i].r_q24 != INVERSE_UNUSED;
    for (unsigned j = 0; j < INVERSE_KNOTS; j++)
        config->knots += config->knot_d_q24[j] != INVERSE_UNUSED;
}

static enum inverse_verdict check(const struct inverse_config *config, const int32_t play_w_q20[INVERSE_PLAYS])
{
    if (config->rest_fraction_q30 < -ONE_Q30 || config->rest_fraction_q30 > ONE_Q30)
        return INVERSE_REST_BEYOND_THRESHOLDS;
    if (!plays_in_order(config->play))
        return INVERSE_PLAYS_OUT_OF_ORDER;
    for (unsigned i = 0; i < INVERSE_PLAYS; i++)
        if (play_w_q20[i] < 0)
            return INVERSE_WEIGHT_NEGATIVE;
    if (!never_falls(config->knot_d_q24, INVERSE_KNOTS))
        return INVERSE_KNOTS_OUT_OF_ORDER;
    int64_t slopes_q20 = (int64_t)magnitude_i64(config->gain_q20) + sum_of_sizes(play_w_q20, INVERSE_PLAYS) +
                         sum_of_sizes(config->knot_s_q20, INVERSE_KNOTS);
    if (slopes_q20 >= SLOPES_MOST_Q20)
        return INVERSE_TOO_STEEP;
    return rises_everywhere(config) ? INVERSE_EXISTS : INVERSE_FALLS;
}

enum inverse_verdict inverse_make(struct inverse_config *config, const int32_t play_w_q20[INVERSE_PLAYS])
{
    enum inverse_verdict verdict = check(config, play_w_q20);
    if (verdict != INVERSE_EXISTS)
        return verdict;
    count_used(config);
    config->play[0].sum_q20 = 0;
    config->play[INVERSE_PLAYS].r_q24 = INVERSE_UNUSED;
    for (unsigned i = 0; i < INVERSE_PLAYS; i++) {
        struct inverse_play *play = &config->play[i];
        play->rest_q24 = (int32_t)round_shift_i64((int64_t)config->rest_fraction_q30 * play->r_q24, 30);
        play[1].sum_q20 = play->sum_q20 + (i < config->plays ? play_w_q20[i] : 0);
    }
    config->play[INVERSE_PLAYS].rest_q24 = 0;
    const struct inverse_state nowhere = {.rises = 1};
    config->rest_x_q44 = inverse_curve_q44(config, 0, &config->rest_knots, &config->rest_slope_q20) +
                         inverse_plays_q44(config, &nowhere);
    return INVERSE_EXISTS;
}

/* Position when all plays were pulled along to v from `side` (1: from below). */
static int32_t extreme_q16(const struct inverse_config *config, int32_t v_q24, int side)
{
    bool saturated = false;
    uint32_t knots;
    int32_t slope_q20;
    int64_t x_q44 = inverse_curve_q44(config, v_q24, &knots, &slope_q20);
    for (unsigned i = 0; i < config->plays; i++)
        x_q44 += inverse_weighted_q44(config, i, v_q24 - side * (int64_t)config->play[i].r_q24);
    return sat_i32(round_shift_i64(x_q44, 28), &saturated);
}

void inverse_reach_q16(const struct inverse_config *config, int32_t *low_q16, int32_t *high_q16)
{
    *low_q16 = extreme_q16(config, config->u_min_q24, -1);
    *high_q16 = extreme_q16(config, config->u_max_q24, 1);
}

/* What plays add to the mean slope of a voltage that goes back and forth by swing_q24: each stands still for twice its
 * threshold after a turn. */
static int64_t plays_slope_q20(const struct inverse_config *config, int64_t swing_q24)
{
    int64_t way_q44 = 0;
    for (unsigned i = 0; i < config->plays; i++) {
        const int64_t left_q24 = swing_q24 - 2 * (int64_t)config->play[i].r_q24;
        if (left_q24 <= 0)
            break;
        way_q44 += inverse_weighted_q44(config, i, left_q24);
    }
    return swing_q24 > 0 ? way_q44 / swing_q24 : 0;
}

int32_t inverse_per_um_q28(const struct inverse_config *config, int32_t share_q28)
{
    bool saturated = false;
    uint32_t knots;
    int32_t slope_q20;
    const int64_t range_q24 = (int64_t)config->u_max_q24 - config->u_min_q24;
    const int64_t low_q44 = inverse_curve_q44(config, config->u_min_q24, &knots, &slope_q20);
    const int64_t high_q44 = inverse_curve_q44(config, config->u_max_q24, &knots, &slope_q20);
    const int64_t swing_q24 = round_shift_i64(range_q24 / 16 * share_q28, 24);
    const int64_t mean_q20 = (high_q44 - low_q44) / range_q24 + plays_slope_q20(config, swing_q24);
    return sat_i32(((int64_t)1 << 48) / (mean_q20 > 0 ? mean_q20 : 1), &saturated);
}
