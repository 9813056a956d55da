#include "core/watch.h"

#include "core/fixed.h"

static uint32_t distance_i32(int32_t a, int32_t b)
{
    return a > b ? (uint32_t)a - (uint32_t)b : (uint32_t)b - (uint32_t)a;
}

/* Consecutive ticks in which something was so, the present one included. */
static uint32_t in_a_row(bool so, uint32_t ticks)
{
    if (!so)
        return 0;
    return ticks == UINT32_MAX ? ticks : ticks + 1;
}

static bool is_at_rail(uint16_t code)
{
    return code < WATCH_RAIL_MARGIN || code > UINT16_MAX - WATCH_RAIL_MARGIN;
}

static void count_jumps(struct watch_state *state, uint16_t code)
{
    if (distance_i32(code, (int32_t)state->code) >= WATCH_JUMP_CODES) {
        state->jumps = state->calm_ticks <= WATCH_JUMP_APART ? in_a_row(true, state->jumps) : 1;
        state->calm_ticks = 0;
    }
    state->calm_ticks = in_a_row(true, state->calm_ticks);
}

static bool is_frozen(const struct watch_config *config, struct watch_state *state, const struct watch_tick *tick)
{
    if (tick->adc_code != state->code) {
        state->same_ticks = 0;
        state->same_u_q24 = tick->u_q24;
        return false;
    }
    state->same_ticks = in_a_row(true, state->same_ticks);
    return state->same_ticks >= WATCH_FROZEN_TICKS &&
           distance_i32(tick->u_q24, state->same_u_q24) > config->u_range_q24 >> WATCH_FROZEN_SHARE_LOG2;
}

static void prime(struct watch_state *state, const struct watch_tick *tick)
{
    state->primed = 1;
    state->code = tick->adc_code;
    state->same_u_q24 = tick->u_q24;
    state->jumps = 0;
    state->calm_ticks = WATCH_JUMP_APART + 1;
}

enum watch_finding watch_codes(const struct watch_config *config, struct watch_state *state,
                               const struct watch_tick *tick)
{
    if (state->primed == 0)
        prime(state, tick);
    count_jumps(state, tick->adc_code);
    bool frozen = is_frozen(config, state, tick);
    state->code = tick->adc_code;
    if (state->jumps >= WATCH_JUMPS)
        return WATCH_JUMPED;
    return frozen && !is_at_rail(tick->adc_code) ? WATCH_FROZEN : WATCH_FINE;
}

enum watch_finding watch_step(const struct watch_config *config, struct watch_state *state,
                              const struct watch_tick *tick)
{
    if (state->primed == 0)
        prime(state, tick);
    bool beyond = distance_i32(tick->error_q16, 0) > (uint32_t)config->error_limit_q16;
    state->rail_ticks = in_a_row(is_at_rail(tick->adc_code), state->rail_ticks);
    state->error_ticks = in_a_row(beyond, state->error_ticks);
    state->limited_ticks = in_a_row(tick->limited, state->limited_ticks);
    count_jumps(state, tick->adc_code);
    bool frozen = is_frozen(config, state, tick);
    state->code = tick->adc_code;
    if (state->rail_ticks >= WATCH_RAIL_TICKS)
        return WATCH_RAIL;
    if (state->jumps >= WATCH_JUMPS)
        return WATCH_JUMPED;
    if (frozen)
        return WATCH_FROZEN;
    if (beyond && state->error_ticks >= config->error_ticks)
        return WATCH_ERROR;
    return state->limited_ticks >= WATCH_LIMITED_TICKS ? WATCH_LIMITED : WATCH_FINE;
}

bool watch_range(struct watch_state *state, uint16_t adc_code, uint32_t low, uint32_t high)
{
    state->range_ticks = in_a_row(adc_code < low || adc_code > high, state->range_ticks);
    return state->range_ticks < WATCH_RANGE_TICKS;
}
