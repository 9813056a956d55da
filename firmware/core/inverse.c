#include "core/inverse.h"

#include "core/fixed.h"

#define FURTHER_THAN_ANY_Q44 INT64_MAX

/* A way up or down. Where things are is told by how far they are from where it began, so that nothing has a sign; what
 * lies behind that is negative, and adds up all the same. */
struct walk {
    uint32_t at_q24;
    uint32_t play_at_q24;            /* the next play's bend */
    uint32_t knot_at_q24, end_q24;   /* the next knot, the limit */
    uint32_t knot_before_q24;        /* a play's bend before this comes next, and is within the limit */
    const struct inverse_play *play; /* the first one that does not move */
    const struct inverse_play *group_end;
    uint32_t turn_at_q24; /* the last turn: plays below group_end begin to move at twice their threshold from it */
    bool onward;          /* all up to the last turn begin to move at it */
    uint32_t knots, turns;
    uint32_t curve_q20, slope_q20; /* slope without and with plays */
    int64_t left_q44;              /* of the way to go, in position */
    bool arrived;                  /* it ends before the next bend */
};

/* Both ways are made from the same text, each with its own signs. */
#define EACH_WAY static inline __attribute__((always_inline))

EACH_WAY uint32_t way_q24(bool rises, int32_t from_q24, int32_t to_q24)
{
    return rises ? (uint32_t)to_q24 - (uint32_t)from_q24 : (uint32_t)from_q24 - (uint32_t)to_q24;
}

/* One that never moved. */
EACH_WAY uint32_t rest_play_at_q24(const struct walk *walk, const struct inverse_config *config,
                                   const struct inverse_state *state, bool rises)
{
    if (walk->play >= config->play + config->plays)
        return UINT32_MAX;
    return way_q24(rises, state->v_q24, walk->play->rest_q24) + (uint32_t)walk->play->r_q24;
}

EACH_WAY uint32_t turned_play_at_q24(const struct walk *walk)
{
    return walk->turn_at_q24 + 2 * (uint32_t)walk->play->r_q24;
}

/* Where another play begins to move: of those that stopped at the last turn all together where the way comes back to
 * it, or else one by one. */
EACH_WAY void find_plays(struct walk *walk, const struct inverse_config *config, const struct inverse_state *state,
                         bool rises)
{
    walk->slope_q20 = walk->curve_q20 + (uint32_t)walk->play->sum_q20;
    walk->onward = false;
    walk->group_end = walk->play;
    if (walk->turns == 0) {
        walk->play_at_q24 = rest_play_at_q24(walk, config, state, rises);
        return;
    }
    uint32_t last = (uint32_t)__builtin_ctz(walk->turns);
    walk->turn_at_q24 = way_q24(rises, state->v_q24, state->turn_q24[last]);
    walk->onward = (state->risen >> last & 1u) == (uint32_t)rises;
    walk->play_at_q24 = walk->turn_at_q24;
    if (!walk->onward) {
        walk->group_end = &config->play[last];
        walk->play_at_q24 = turned_play_at_q24(walk);
    }
}

EACH_WAY void find_knot(struct walk *walk, const struct inverse_config *config, const struct inverse_state *state,
                        bool rises)
{
    uint32_t knot = rises ? walk->knots : walk->knots - 1;
    walk->knot_at_q24 = knot < config->knots ? way_q24(rises, state->v_q24, config->knot_d_q24[knot]) : UINT32_MAX;
    walk->knot_before_q24 = walk->knot_at_q24 < walk->end_q24 ? walk->knot_at_q24 + 1 : walk->end_q24;
}

EACH_WAY void pass_play(struct walk *walk, const struct inverse_config *config, const struct inverse_state *state,
                        bool rises)
{
    if (walk->play != walk->group_end) {
        walk->play++;
        walk->slope_q20 = walk->curve_q20 + (uint32_t)walk->play->sum_q20;
        walk->play_at_q24 = turned_play_at_q24(walk);
        return;
    }
    if (walk->turns == 0) {
        walk->play++;
        walk->group_end = walk->play;
        walk->slope_q20 = walk->curve_q20 + (uint32_t)walk->play->sum_q20;
        walk->play_at_q24 = rest_play_at_q24(walk, config, state, rises);
        return;
    }
    walk->play = walk->onward ? &config->play[__builtin_ctz(walk->turns)] + 1 : walk->play + 1;
    walk->turns &= walk->turns - 1;
    find_plays(walk, config, state, rises);
}

EACH_WAY void pass_knot(struct walk *walk, const struct inverse_config *config, const struct inverse_state *state,
                        bool rises)
{
    uint32_t knot = rises ? walk->knots++ : --walk->knots;
    uint32_t bend_q20 = (uint32_t)config->knot_s_q20[knot];
    walk->curve_q20 += rises ? bend_q20 : 0 - bend_q20;
    walk->slope_q20 += rises ? bend_q20 : 0 - bend_q20;
    find_knot(walk, config, state, rises);
}

/* False when what is left of the way does not take it to the bend. */
EACH_WAY bool goes_to(struct walk *walk, uint32_t bend_at_q24)
{
    int64_t way_q44 = (int64_t)((uint64_t)walk->slope_q20 * (bend_at_q24 - walk->at_q24));
    walk->left_q44 -= way_q44;
    if (walk->left_q44 < 0) {
        walk->left_q44 += way_q44;
        return false;
    }
    walk->at_q24 = bend_at_q24;
    return true;
}

/* To the next bend if the way goes further than that. */
EACH_WAY void walk_on(struct walk *walk, const struct inverse_config *config, const struct inverse_state *state,
                      bool rises)
{
    if (walk->play_at_q24 < walk->knot_before_q24) {
        if (goes_to(walk, walk->play_at_q24))
            pass_play(walk, config, state, rises);
        else
            walk->arrived = true;
    } else {
        if (walk->knot_at_q24 < walk->end_q24 && goes_to(walk, walk->knot_at_q24))
            pass_knot(walk, config, state, rises);
        else
            walk->arrived = true;
    }
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

/* On the last piece: to the nearest voltage, or to the end. False when the end is nearer than the position. */
EACH_WAY bool finish(struct walk *walk)
{
    const uint32_t slope_q20 = walk->slope_q20;
    uint32_t room_q24 = walk->end_q24 - walk->at_q24;
    uint64_t rounded_q44 = (uint64_t)walk->left_q44 + slope_q20 / 2;
    bool reached = rounded_q44 < (uint64_t)slope_q20 * room_q24 + slope_q20;
    uint32_t length_q24 = reached ? ratio_u32(rounded_q44, slope_q20) : room_q24;
    walk->at_q24 += length_q24;
    walk->left_q44 -= (int64_t)((uint64_t)slope_q20 * length_q24); /* by half an LSB below 0, perhaps */
    return reached;
}

/* As far as voltage and position allow, and the bends of a tick. False when the position was not reached. */
EACH_WAY bool walk_way(const struct inverse_config *config, struct inverse_state *state, bool rises, int32_t end_q24,
                       int64_t way_q44)
{
    if (state->rises != (uint32_t)rises)
        turn(state, rises);
    struct walk walk = {.end_q24 = way_q24(rises, state->v_q24, end_q24),
                        .left_q44 = way_q44,
                        .play = &config->play[state->moving],
                        .knots = state->knots,
                        .turns = state->turns,
                        .curve_q20 = (uint32_t)state->slope_q20};
    find_plays(&walk, config, state, rises);
    find_knot(&walk, config, state, rises);
    for (unsigned i = 0; i < INVERSE_BENDS_A_TICK; i++)
        if (!walk.arrived)
            walk_on(&walk, config, state, rises);
    bool reached = walk.arrived && finish(&walk);
    uint32_t v_q24 = (uint32_t)state->v_q24;
    way_q44 -= walk.left_q44;
    state->v_q24 = (int32_t)(rises ? v_q24 + walk.at_q24 : v_q24 - walk.at_q24);
    state->x_q44 += rises ? way_q44 : -way_q44;
    state->slope_q20 = (int32_t)walk.curve_q20;
    state->knots = walk.knots;
    state->moving = (uint32_t)(walk.play - config->play);
    state->turns = walk.turns;
    return reached;
}

static __attribute__((noinline)) bool walk_up(const struct inverse_config *config, struct inverse_state *state,
                                              int32_t end_q24, int64_t way_q44)
{
    return walk_way(config, state, true, end_q24, way_q44);
}

static __attribute__((noinline)) bool walk_down(const struct inverse_config *config, struct inverse_state *state,
                                                int32_t end_q24, int64_t way_q44)
{
    return walk_way(config, state, false, end_q24, way_q44);
}

void inverse_follow(const struct inverse_config *config, struct inverse_state *state, int32_t v_q24)
{
    v_q24 = clamp_i32(v_q24, config->u_min_q24, config->u_max_q24);
    if (v_q24 > state->v_q24)
        walk_up(config, state, v_q24, FURTHER_THAN_ANY_Q44);
    else if (v_q24 < state->v_q24)
        walk_down(config, state, v_q24, FURTHER_THAN_ANY_Q44);
}

int32_t inverse_step_q24(const struct inverse_config *config, struct inverse_state *state, int64_t x_q44,
                         bool *saturated)
{
    bool reached = true;
    if (x_q44 > state->x_q44)
        reached = walk_up(config, state, config->u_max_q24, x_q44 - state->x_q44);
    else if (x_q44 < state->x_q44)
        reached = walk_down(config, state, config->u_min_q24, state->x_q44 - x_q44);
    if (!reached)
        *saturated = true;
    return state->v_q24;
}
