#include "core/inverse_memory.h"

#include "core/fixed.h"

int64_t inverse_curve_q44(const struct inverse_config *config, int32_t v_q24, uint32_t *knots, int32_t *slope_q20)
{
    int64_t x_q44 = (int64_t)config->offset_q16 * (1 << 28) + (int64_t)config->gain_q20 * v_q24;
    *knots = 0;
    *slope_q20 = config->gain_q20;
    for (unsigned j = 0; j < config->knots; j++) {
        int64_t above_q24 = (int64_t)v_q24 - config->knot_d_q24[j];
        if (above_q24 >= 0) {
            x_q44 += config->knot_s_q20[j] * above_q24;
            *slope_q20 += config->knot_s_q20[j];
            (*knots)++;
        }
    }
    return x_q44;
}

int64_t inverse_play_q24(const struct inverse_config *config, const struct inverse_state *state, unsigned play)
{
    int64_t r_q24 = config->play[play].r_q24;
    uint32_t turns = state->turns >> play; /* the play stopped at the nearest turn from here on up */
    if (play < state->moving)
        return state->rises != 0 ? state->v_q24 - r_q24 : state->v_q24 + r_q24;
    if (turns == 0)
        return config->play[play].rest_q24;
    unsigned last = play + trailing_zeros_u32(turns);
    return (state->risen >> last & 1u) != 0 ? state->turn_q24[last] - r_q24 : state->turn_q24[last] + r_q24;
}

int64_t inverse_weighted_q44(const struct inverse_config *config, unsigned play, int64_t play_q24)
{
    return (config->play[play + 1].sum_q20 - config->play[play].sum_q20) * play_q24;
}

int64_t inverse_plays_q44(const struct inverse_config *config, const struct inverse_state *state)
{
    int64_t x_q44 = 0;
    for (unsigned i = 0; i < config->plays; i++)
        x_q44 += inverse_weighted_q44(config, i, inverse_play_q24(config, state, i));
    return x_q44;
}

void inverse_rest(const struct inverse_config *config, struct inverse_state *state, int32_t v_q24)
{
    *state = (struct inverse_state){
        .rises = 1, .x_q44 = config->rest_x_q44, .slope_q20 = config->rest_slope_q20, .knots = config->rest_knots};
    inverse_follow(config, state, v_q24);
}

/* Each time as far as a tick would. */
static void go_to(const struct inverse_config *config, struct inverse_state *state, int64_t v_q24)
{
    const int32_t end_q24 = v_q24 > config->u_max_q24   ? config->u_max_q24
                            : v_q24 < config->u_min_q24 ? config->u_min_q24
                                                        : (int32_t)v_q24;
    for (unsigned n = 0; n <= INVERSE_PLAYS + INVERSE_KNOTS && state->v_q24 != end_q24; n++)
        inverse_follow(config, state, end_q24);
}

void inverse_begin_after(const struct inverse_config *config, struct inverse_state *state,
                         const struct extremes *extremes, int32_t v_q24)
{
    inverse_rest(config, state, 0);
    go_to(config, state, extremes->rose_last != 0 ? extremes->low_q24 : extremes->high_q24);
    go_to(config, state, extremes->rose_last != 0 ? extremes->high_q24 : extremes->low_q24);
    go_to(config, state, v_q24);
}

/* To a turn that a play of this threshold has come to along with the voltage, and so have all smaller ones. It comes
 * from two thresholds away: any nearer the play would not have moved all the way, and the stage was at least so far. */
static void go_along(const struct inverse_config *config, struct inverse_state *state, int64_t r_q24, bool rises,
                     int32_t turn_q24)
{
    go_to(config, state, rises ? turn_q24 - 2 * r_q24 : turn_q24 + 2 * r_q24);
    go_to(config, state, turn_q24);
}

void inverse_recall(const struct inverse_config *config, struct inverse_state *state,
                    const struct inverse_config *before, const struct inverse_state *old, int32_t v_q24)
{
    inverse_rest(config, state, 0);
    for (unsigned i = INVERSE_PLAYS; i-- > 0;)
        if ((old->turns >> i & 1u) != 0)
            go_along(config, state, before->play[i].r_q24, (old->risen >> i & 1u) != 0, old->turn_q24[i]);
    if (old->moving > 0)
        go_along(config, state, before->play[old->moving - 1].r_q24, old->rises != 0, old->v_q24);
    go_to(config, state, v_q24);
}

/* Every play within its threshold of the voltage, and a larger one no nearer to moving than a smaller one. */
static bool plays_fit(const struct inverse_config *config, const struct inverse_state *state)
{
    int64_t up_before_q24 = 0, down_before_q24 = 0;
    for (unsigned i = 0; i < config->plays; i++) {
        int64_t from_q24 = inverse_play_q24(config, state, i) - state->v_q24;
        int64_t up_q24 = config->play[i].r_q24 + from_q24, down_q24 = config->play[i].r_q24 - from_q24;
        if (up_q24 < up_before_q24 || down_q24 < down_before_q24)
            return false;
        up_before_q24 = up_q24;
        down_before_q24 = down_q24;
    }
    return true;
}

static bool is_allowed(const struct inverse_config *config, int32_t v_q24)
{
    return v_q24 >= config->u_min_q24 && v_q24 <= config->u_max_q24;
}

static bool within_format(const struct inverse_config *config, const struct inverse_state *state)
{
    bool fits = state->rises <= 1 && state->moving <= config->plays && is_allowed(config, state->v_q24);
    for (unsigned i = 0; i < INVERSE_PLAYS && fits; i++)
        if (state->turns >> i & 1u)
            fits = i >= state->moving && i < config->plays && is_allowed(config, state->turn_q24[i]);
    return fits;
}

/* A knot at v itself may have been passed or not. */
static bool knots_fit(const struct inverse_config *config, const struct inverse_state *state)
{
    int64_t slope_q20 = config->gain_q20;
    for (unsigned j = 0; j < config->knots && j < state->knots; j++)
        slope_q20 += config->knot_s_q20[j];
    return state->knots <= config->knots && slope_q20 == state->slope_q20 &&
           (state->knots == 0 || config->knot_d_q24[state->knots - 1] <= state->v_q24) &&
           (state->knots == config->knots || config->knot_d_q24[state->knots] >= state->v_q24);
}

void inverse_admit(const struct inverse_config *config, struct inverse_state *state)
{
    uint32_t knots;
    int32_t slope_q20;
    bool is_memory =
        within_format(config, state) && knots_fit(config, state) && plays_fit(config, state) &&
        inverse_curve_q44(config, state->v_q24, &knots, &slope_q20) + inverse_plays_q44(config, state) == state->x_q44;
    if (!is_memory)
        inverse_rest(config, state, clamp_i32(state->v_q24, config->u_min_q24, config->u_max_q24));
}
