#include "core/inverse.h"

#include "core/fixed.h"

void inverse_follow(const struct inverse_config *config, struct inverse_state *state, int32_t v_q24)
{
    bool dragged = false;
    for (unsigned i = 0; i < INVERSE_PLAYS; i++) {
        int64_t r_q24 = config->play_r_q24[i];
        if (r_q24 != INVERSE_UNUSED)
            state->play_q24[i] = (int32_t)sat_between_i64(state->play_q24[i], v_q24 - r_q24, v_q24 + r_q24, &dragged);
    }
    state->v_q24 = v_q24;
}

void inverse_rest(const struct inverse_config *config, struct inverse_state *state, int32_t v_q24)
{
    for (unsigned i = 0; i < INVERSE_PLAYS; i++)
        state->play_q24[i] = (int32_t)round_shift_i64((int64_t)config->rest_fraction_q30 * config->play_r_q24[i], 30);
    inverse_follow(config, state, v_q24);
}

/* The part without memory; *knots: how many lie at or below v, *slope_q20: its slope above v. */
static int64_t curve_q44(const struct inverse_config *config, int32_t v_q24, unsigned *knots, int64_t *slope_q20)
{
    int64_t x_q44 = (int64_t)config->offset_q16 * (1 << 28) + (int64_t)config->gain_q20 * v_q24;
    *knots = 0;
    *slope_q20 = config->gain_q20;
    for (unsigned j = 0; j < INVERSE_KNOTS; j++) {
        int64_t above_q24 = (int64_t)v_q24 - config->knot_d_q24[j];
        if (above_q24 >= 0) {
            x_q44 += config->knot_s_q20[j] * above_q24;
            *slope_q20 += config->knot_s_q20[j];
            (*knots)++;
        }
    }
    return x_q44;
}

static int64_t plays_q44(const struct inverse_config *config, const struct inverse_state *state)
{
    int64_t x_q44 = 0;
    for (unsigned i = 0; i < INVERSE_PLAYS; i++)
        if (config->play_r_q24[i] != INVERSE_UNUSED)
            x_q44 += (int64_t)config->play_w_q20[i] * state->play_q24[i];
    return x_q44;
}

int64_t inverse_position_q44(const struct inverse_config *config, const struct inverse_state *state)
{
    unsigned knots;
    int64_t slope_q20;
    return curve_q44(config, state->v_q24, &knots, &slope_q20) + plays_q44(config, state);
}

struct walk { /* upwards, or mirrored: with all voltages of the other sign */
    int64_t v_q24, end_q24;
    int64_t slope_q20;
    int64_t left_q44; /* of the way to go, in position */
    unsigned play, knot;
    bool arrived; /* what is left ends before the next bend */
};

/* To the next bend if the way goes further than that. Once it does not, later calls do nothing. */
static void walk_on(struct walk *walk, const struct inverse_config *config, const struct inverse_state *state, int sign)
{
    int64_t play_q24 = INT64_MAX, knot_q24 = INT64_MAX;
    unsigned knot = sign > 0 ? walk->knot : walk->knot - 1; /* of the mirrored ones the nearest is the last below */
    if (walk->play < INVERSE_PLAYS && config->play_r_q24[walk->play] != INVERSE_UNUSED)
        play_q24 = sign * (int64_t)state->play_q24[walk->play] + config->play_r_q24[walk->play];
    if (knot < INVERSE_KNOTS)
        knot_q24 = sign * (int64_t)config->knot_d_q24[knot];
    bool at_play = play_q24 <= knot_q24;
    int64_t bend_q24 = at_play ? play_q24 : knot_q24;
    int64_t length_q24 = bend_q24 > walk->v_q24 ? bend_q24 - walk->v_q24 : 0;
    walk->arrived = bend_q24 >= walk->end_q24 || walk->left_q44 < walk->slope_q20 * length_q24;
    if (walk->arrived)
        return;
    walk->left_q44 -= walk->slope_q20 * length_q24;
    walk->v_q24 += length_q24;
    if (at_play) {
        walk->slope_q20 += config->play_w_q20[walk->play++];
    } else {
        walk->slope_q20 += sign * config->knot_s_q20[knot];
        walk->knot = sign > 0 ? walk->knot + 1 : walk->knot - 1;
    }
}

/* From where the memory stands towards x. Plays that are at their bend already go along from the start: they are the
 * first ones, for a larger threshold never moves without the smaller. */
static struct walk begin_walk(const struct inverse_config *config, const struct inverse_state *state, int64_t x_q44,
                              int *sign)
{
    struct walk walk = {.play = 0};
    int64_t here_q44 = curve_q44(config, state->v_q24, &walk.knot, &walk.slope_q20) + plays_q44(config, state);
    *sign = x_q44 < here_q44 ? -1 : 1;
    walk.v_q24 = *sign * (int64_t)state->v_q24;
    walk.end_q24 = *sign > 0 ? config->u_max_q24 : -(int64_t)config->u_min_q24;
    walk.left_q44 = *sign > 0 ? x_q44 - here_q44 : here_q44 - x_q44;
    for (unsigned i = 0; i < INVERSE_PLAYS; i++)
        if (config->play_r_q24[i] != INVERSE_UNUSED &&
            *sign * (int64_t)state->play_q24[i] + config->play_r_q24[i] <= walk.v_q24) {
            walk.slope_q20 += config->play_w_q20[i];
            walk.play++;
        }
    return walk;
}

int32_t inverse_step_q24(const struct inverse_config *config, struct inverse_state *state, int64_t x_q44,
                         bool *saturated)
{
    int sign;
    state->v_q24 = clamp_i32(state->v_q24, config->u_min_q24, config->u_max_q24);
    struct walk walk = begin_walk(config, state, x_q44, &sign);
    for (unsigned i = 0; i < INVERSE_BENDS_A_TICK; i++)
        walk_on(&walk, config, state, sign);
    int64_t v_q24 = walk.v_q24;
    if (walk.arrived) {
        uint64_t half_q44 = (uint64_t)walk.slope_q20 / 2;
        v_q24 += ratio_u32((uint64_t)walk.left_q44 + half_q44, (uint64_t)walk.slope_q20);
    }
    if (v_q24 > walk.end_q24 || !walk.arrived)
        *saturated = true;
    v_q24 = v_q24 > walk.end_q24 ? walk.end_q24 : v_q24;
    inverse_follow(config, state, (int32_t)(sign * v_q24));
    return state->v_q24;
}
