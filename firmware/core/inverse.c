#include "core/inverse.h"

#include "core/fixed.h"

#define FURTHER_THAN_ANY_Q44 ((uint64_t)1 << 63)

/* A way up or down. Where things are is told by how far they are from where it began, so that nothing has a sign; what
 * lies behind that is negative, and adds up all the same. */
struct walk {
    uint32_t at_q24, end_q24;
    uint32_t play_at_q24, knot_at_q24; /* the next bends */
    uint32_t moving, knots, turns;     /* as in the state */
    uint32_t then_moving;              /* behind the play's bend */
    uint32_t slope_q20;
    uint64_t left_q44; /* of the way to go, in position */
    bool arrived;      /* it ends before the next bend */
};

static inline uint32_t way_q24(bool rises, int32_t from_q24, int32_t to_q24)
{
    return rises ? (uint32_t)to_q24 - (uint32_t)from_q24 : (uint32_t)from_q24 - (uint32_t)to_q24;
}

/* Where another play begins to move, and how many do then. */
static inline void find_play(struct walk *walk, const struct inverse_config *config, const struct inverse_state *state,
                             bool rises)
{
    uint32_t play = walk->moving;
    walk->then_moving = play + 1;
    walk->play_at_q24 = UINT32_MAX;
    if (play >= config->plays)
        return;
    int32_t r_q24 = config->play_r_q24[play];
    if (walk->turns == 0) {
        int32_t rest_q24 = (int32_t)round_shift_i64((int64_t)config->rest_fraction_q30 * r_q24, 30);
        walk->play_at_q24 = way_q24(rises, state->v_q24, rest_q24) + (uint32_t)r_q24;
        return;
    }
    uint32_t last = (uint32_t)__builtin_ctz(walk->turns);
    uint32_t turn_at_q24 = way_q24(rises, state->v_q24, state->turn_q24[last]);
    bool onward = (state->risen >> last & 1u) == (uint32_t)rises;
    walk->play_at_q24 = onward ? turn_at_q24 : turn_at_q24 + 2 * (uint32_t)r_q24;
    walk->then_moving = onward ? last + 1 : play + 1;
}

static inline void find_knot(struct walk *walk, const struct inverse_config *config, const struct inverse_state *state,
                             bool rises)
{
    uint32_t knot = rises ? walk->knots : walk->knots - 1;
    walk->knot_at_q24 = knot < config->knots ? way_q24(rises, state->v_q24, config->knot_d_q24[knot]) : UINT32_MAX;
}

static inline void pass_play(struct walk *walk, const struct inverse_config *config)
{
    walk->slope_q20 += (uint32_t)(config->play_sum_q20[walk->then_moving] - config->play_sum_q20[walk->moving]);
    walk->moving = walk->then_moving;
    if (walk->turns != 0 && walk->moving > (uint32_t)__builtin_ctz(walk->turns))
        walk->turns &= walk->turns - 1;
}

static inline void pass_knot(struct walk *walk, const struct inverse_config *config, bool rises)
{
    uint32_t knot = rises ? walk->knots++ : --walk->knots;
    uint32_t bend_q20 = (uint32_t)config->knot_s_q20[knot];
    walk->slope_q20 += rises ? bend_q20 : 0 - bend_q20;
}

/* To the next bend if the way goes further than that. */
static inline void walk_on(struct walk *walk, const struct inverse_config *config, const struct inverse_state *state,
                           bool rises)
{
    bool at_play = walk->play_at_q24 <= walk->knot_at_q24;
    uint32_t bend_at_q24 = at_play ? walk->play_at_q24 : walk->knot_at_q24;
    uint64_t way_q44 = (uint64_t)walk->slope_q20 * (bend_at_q24 - walk->at_q24);
    walk->arrived = bend_at_q24 >= walk->end_q24 || walk->left_q44 < way_q44;
    if (walk->arrived)
        return;
    walk->left_q44 -= way_q44;
    walk->at_q24 = bend_at_q24;
    if (at_play) {
        pass_play(walk, config);
        find_play(walk, config, state, rises);
    } else {
        pass_knot(walk, config, rises);
        find_knot(walk, config, state, rises);
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
static inline bool finish(struct walk *walk)
{
    uint32_t room_q24 = walk->end_q24 - walk->at_q24;
    uint64_t rounded_q44 = walk->left_q44 + walk->slope_q20 / 2;
    bool reached = rounded_q44 < (uint64_t)walk->slope_q20 * room_q24 + walk->slope_q20;
    uint32_t length_q24 = reached ? ratio_u32(rounded_q44, walk->slope_q20) : room_q24;
    walk->at_q24 += length_q24;
    walk->left_q44 -= (uint64_t)walk->slope_q20 * length_q24; /* by half an LSB below 0, perhaps */
    return reached;
}

/* As far as voltage and position allow, and the bends of a tick. False when the position was not reached. */
static inline bool walk_way(const struct inverse_config *config, struct inverse_state *state, bool rises,
                            int32_t end_q24, uint64_t way_q44)
{
    if (state->rises != (uint32_t)rises)
        turn(state, rises);
    struct walk walk = {.end_q24 = way_q24(rises, state->v_q24, end_q24),
                        .left_q44 = way_q44,
                        .moving = state->moving,
                        .knots = state->knots,
                        .turns = state->turns,
                        .slope_q20 = (uint32_t)(state->slope_q20 + config->play_sum_q20[state->moving])};
    find_play(&walk, config, state, rises);
    find_knot(&walk, config, state, rises);
    for (unsigned i = 0; i < INVERSE_BENDS_A_TICK; i++)
        if (!walk.arrived)
            walk_on(&walk, config, state, rises);
    bool reached = walk.arrived && finish(&walk);
    uint32_t v_q24 = (uint32_t)state->v_q24;
    way_q44 -= walk.left_q44;
    state->v_q24 = (int32_t)(rises ? v_q24 + walk.at_q24 : v_q24 - walk.at_q24);
    state->x_q44 += (int64_t)(rises ? way_q44 : 0 - way_q44);
    state->slope_q20 = (int32_t)walk.slope_q20 - config->play_sum_q20[walk.moving];
    state->knots = walk.knots;
    state->moving = walk.moving;
    state->turns = walk.turns;
    return reached;
}

static bool walk_up(const struct inverse_config *config, struct inverse_state *state, int32_t end_q24, uint64_t way_q44)
{
    return walk_way(config, state, true, end_q24, way_q44);
}

static bool walk_down(const struct inverse_config *config, struct inverse_state *state, int32_t end_q24,
                      uint64_t way_q44)
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
        reached = walk_up(config, state, config->u_max_q24, (uint64_t)(x_q44 - state->x_q44));
    else if (x_q44 < state->x_q44)
        reached = walk_down(config, state, config->u_min_q24, (uint64_t)(state->x_q44 - x_q44));
    if (!reached)
        *saturated = true;
    return state->v_q24;
}
