#include "core/inverse.h"

#include "core/fixed.h"

/* A way up or down. A place on it is its distance from where the way began, so that the rest of the code is the same
 * for up and down. The distance of a place before the beginning wraps around, and sums with it still come out right. */
struct walk {
    const struct inverse_config *config;
    const struct inverse_state *state;
    bool rises;
    uint32_t at_q24, end_q24;        /* how far it has come; the limit of the voltage */
    uint32_t play_at_q24;            /* where the next play begins to move */
    uint32_t knot_at_q24;            /* the next knot */
    const struct inverse_play *play; /* the first one that does not move */
    const struct inverse_play *group_end;
    uint32_t turn_at_q24; /* the last turn: plays below group_end begin to move at twice their threshold from it */
    bool onward;          /* the way leads back to the last turn, where all its plays begin to move together */
    uint32_t knots, turns;
    uint32_t curve_q20; /* slope without plays */
    int64_t rest_q44;   /* change of position still to come */
};

static uint32_t distance_q24(const struct walk *walk, int32_t voltage_q24)
{
    uint32_t from_q24 = (uint32_t)walk->state->v_q24, to_q24 = (uint32_t)voltage_q24;
    return walk->rises ? to_q24 - from_q24 : from_q24 - to_q24;
}

static uint32_t slope_q20(const struct walk *walk)
{
    return walk->curve_q20 + (uint32_t)walk->play->sum_q20;
}

/* Where the next play begins to move, if it has not moved since the stage was at rest. */
static uint32_t rest_play_at_q24(const struct walk *walk)
{
    if (walk->play >= walk->config->play + walk->config->plays)
        return UINT32_MAX;
    return distance_q24(walk, walk->play->rest_q24) + (uint32_t)walk->play->r_q24;
}

/* The same, if it stopped at the last turn and has to move the other way. */
static uint32_t turned_play_at_q24(const struct walk *walk)
{
    return walk->turn_at_q24 + 2 * (uint32_t)walk->play->r_q24;
}

/* Where the next play begins to move. Plays that stopped at the last turn begin together if the way comes back to that
 * turn, else one by one. */
static void find_play(struct walk *walk)
{
    walk->onward = false;
    walk->group_end = walk->play;
    if (walk->turns == 0) {
        walk->play_at_q24 = rest_play_at_q24(walk);
        return;
    }
    unsigned last = trailing_zeros_u32(walk->turns);
    bool turn_ended_a_rise = (walk->state->risen >> last & 1u) != 0;
    walk->turn_at_q24 = distance_q24(walk, walk->state->turn_q24[last]);
    walk->onward = turn_ended_a_rise == walk->rises;
    walk->play_at_q24 = walk->turn_at_q24;
    if (!walk->onward) {
        walk->group_end = &walk->config->play[last];
        walk->play_at_q24 = turned_play_at_q24(walk);
    }
}

static void find_knot(struct walk *walk)
{
    uint32_t knot = walk->rises ? walk->knots : walk->knots - 1;
    walk->knot_at_q24 = knot < walk->config->knots ? distance_q24(walk, walk->config->knot_d_q24[knot]) : UINT32_MAX;
}

static void pass_play(struct walk *walk)
{
    if (walk->play != walk->group_end) {
        walk->play++;
        walk->play_at_q24 = turned_play_at_q24(walk);
        return;
    }
    walk->play = walk->onward ? &walk->config->play[trailing_zeros_u32(walk->turns)] + 1 : walk->play + 1;
    walk->turns &= walk->turns - 1; /* the loop is closed: this turn is forgotten */
    find_play(walk);
}

static void pass_knot(struct walk *walk)
{
    uint32_t knot = walk->rises ? walk->knots++ : --walk->knots;
    uint32_t bend_q20 = (uint32_t)walk->config->knot_s_q20[knot];
    walk->curve_q20 += walk->rises ? bend_q20 : 0 - bend_q20;
    find_knot(walk);
}

/* False when what is left of the way does not take it to the bend. */
static bool goes_to(struct walk *walk, uint32_t bend_at_q24)
{
    int64_t way_q44 = (int64_t)((uint64_t)slope_q20(walk) * (bend_at_q24 - walk->at_q24));
    if (walk->rest_q44 < way_q44)
        return false;
    walk->rest_q44 -= way_q44;
    walk->at_q24 = bend_at_q24;
    return true;
}

/* Past the next bend. False when the way ends before it. Where a play and a knot coincide, the play is first. A play
 * beyond the limit does not count; one exactly at the limit, where the way ends, may be left out. */
static bool walk_on(struct walk *walk)
{
    const bool knot_is_near = walk->knot_at_q24 < walk->end_q24;
    const bool play_is_next = knot_is_near ? walk->play_at_q24 <= walk->knot_at_q24 : walk->play_at_q24 < walk->end_q24;
    const uint32_t bend_at_q24 = play_is_next ? walk->play_at_q24 : walk->knot_at_q24;
    if ((!play_is_next && !knot_is_near) || !goes_to(walk, bend_at_q24))
        return false;
    if (play_is_next)
        pass_play(walk);
    else
        pass_knot(walk);
    return true;
}

/* The plays that moved stop where they are. */
static void turn(struct inverse_state *state, bool rises)
{
    if (state->moving != 0) {
        uint32_t last = state->moving - 1, bit = 1u << last;
        state->turn_q24[last] = state->v_q24;
        state->turns |= bit;
        state->risen = state->rises != 0 ? state->risen | bit : state->risen & ~bit;
    }
    state->moving = 0;
    state->rises = rises;
}

/* On the last piece: to the nearest voltage, or to the limit. False when the limit comes before the position. */
static bool finish(struct walk *walk)
{
    const uint32_t slope = slope_q20(walk), room_q24 = walk->end_q24 - walk->at_q24;
    uint64_t rounded_q44 = (uint64_t)walk->rest_q44 + slope / 2;
    bool reached = rounded_q44 < (uint64_t)slope * room_q24 + slope;
    uint32_t length_q24 = reached ? ratio_u32(rounded_q44, slope) : room_q24;
    walk->at_q24 += length_q24;
    walk->rest_q44 -= (int64_t)((uint64_t)slope * length_q24); /* perhaps half an LSB below 0 */
    return reached;
}

/* What the walk has changed. `way_q44` is how far the position has gone. */
static void arrive(const struct walk *walk, struct inverse_state *state, int64_t way_q44)
{
    uint32_t v_q24 = (uint32_t)state->v_q24;
    state->v_q24 = (int32_t)(walk->rises ? v_q24 + walk->at_q24 : v_q24 - walk->at_q24);
    state->x_q44 += walk->rises ? way_q44 : -way_q44;
    state->slope_q20 = (int32_t)walk->curve_q20;
    state->knots = walk->knots;
    state->moving = (uint32_t)(walk->play - walk->config->play);
    state->turns = walk->turns;
}

/* As far as voltage, position and the bends of a tick allow. False when the position was not reached. */
static bool walk_to(const struct inverse_config *config, struct inverse_state *state, bool rises, int32_t end_q24,
                    int64_t way_q44)
{
    if ((state->rises != 0) != rises)
        turn(state, rises);
    struct walk walk = {.config = config,
                        .state = state,
                        .rises = rises,
                        .rest_q44 = way_q44,
                        .play = &config->play[state->moving],
                        .knots = state->knots,
                        .turns = state->turns,
                        .curve_q20 = (uint32_t)state->slope_q20};
    walk.end_q24 = distance_q24(&walk, end_q24);
    find_play(&walk);
    find_knot(&walk);
    bool before_a_bend = false;
    for (unsigned i = 0; i < INVERSE_BENDS_A_TICK; i++)
        before_a_bend = before_a_bend || !walk_on(&walk);
    bool reached = before_a_bend && finish(&walk);
    arrive(&walk, state, way_q44 - walk.rest_q44);
    return reached;
}

void inverse_follow(const struct inverse_config *config, struct inverse_state *state, int32_t v_q24)
{
    v_q24 = clamp_i32(v_q24, config->u_min_q24, config->u_max_q24);
    if (v_q24 != state->v_q24)
        walk_to(config, state, v_q24 > state->v_q24, v_q24, INT64_MAX /* no position ends it */);
}

int32_t inverse_step_q24(const struct inverse_config *config, struct inverse_state *state, int64_t x_q44,
                         int32_t most_q24, bool *saturated)
{
    const bool rises = x_q44 > state->x_q44;
    const int64_t way_q44 = rises ? x_q44 - state->x_q44 : state->x_q44 - x_q44;
    const int64_t end_q24 = (int64_t)state->v_q24 + (rises ? most_q24 : -(int64_t)most_q24);
    const int32_t limit_q24 = end_q24 > config->u_max_q24   ? config->u_max_q24
                              : end_q24 < config->u_min_q24 ? config->u_min_q24
                                                            : (int32_t)end_q24;
    if (way_q44 != 0 && !walk_to(config, state, rises, limit_q24, way_q44))
        *saturated = true;
    return state->v_q24;
}
