#include "core/path.h"

#include <stddef.h>

#include "core/fixed.h"
#include "core/sine.h"

#define ONE_Q30 ((int64_t)1 << 30)
#define ONE_Q31 ((int64_t)1 << 31)
#define QUARTER_TURN32 0x40000000u
#define HALF_TURN32 0x80000000u /* rounds turn64 to turn32 */

bool path_is_periodic(const struct path_config *config)
{
    return config->kind == PATH_SINE || config->kind == PATH_WAVE;
}

void path_start(struct path_state *state)
{
    state->phase_turn64 = 0;
    state->elapsed = 0;
    state->running = 1;
    state->wait_ticks = 0;
}

/* offset + swing x share / 2^bits. |share| <= 2^31, so the product stays within 2^62. */
static int32_t part_of_swing(const struct path_config *config, int64_t share, unsigned bits, bool *saturated)
{
    return sat_i32(config->offset + floor_shift_i64(config->swing * share + ((int64_t)1 << (bits - 1)), bits),
                   saturated);
}

static int32_t wave_q30_at(const int32_t *wave_q30, uint32_t phase_turn32)
{
    uint32_t point = phase_turn32 >> 22;
    uint32_t fraction_q30 = (phase_turn32 << 10) >> 2;
    return lerp_i32(wave_q30[point], wave_q30[(point + 1) % WAVE_POINTS], fraction_q30);
}

/* The way's share at a fraction s of its time: 10 s^3 - 15 s^4 + 6 s^5, the polynomial of least jerk, at rest with no
 * acceleration at both ends (Flash & Hogan 1985). Within 8 LSB. */
static int64_t least_jerk_q31(uint64_t phase_turn64)
{
    if (phase_turn64 >= UINT64_MAX - INT32_MAX) /* would round to 1, which 32 bits cannot hold */
        return ONE_Q31;
    uint32_t s_q32 = (uint32_t)((phase_turn64 + HALF_TURN32) >> 32);
    uint32_t s2_q32 = (uint32_t)(((uint64_t)s_q32 * s_q32) >> 32);
    uint32_t s3_q32 = (uint32_t)(((uint64_t)s2_q32 * s_q32) >> 32);
    uint64_t rest_q31 = ((uint64_t)10 << 31) - 15 * (uint64_t)s_q32 / 2 + 3 * (uint64_t)s2_q32;
    int64_t share_q31 = (int64_t)((s3_q32 * rest_q31) >> 32); /* s^3 rest <= 1: below 2^64 */
    return share_q31 < ONE_Q31 ? share_q31 : ONE_Q31;
}

static uint32_t rounded_turn32(uint64_t phase_turn64)
{
    return (uint32_t)((phase_turn64 + HALF_TURN32) >> 32);
}

/* 0 .. 2^31: it begins at its lowest, a quarter turn behind a sine. */
static int64_t sine_share_q31(uint32_t phase_turn32)
{
    return ONE_Q30 + sine_q30(phase_turn32 - QUARTER_TURN32);
}

static int32_t value_at(const struct path_config *config, uint64_t phase_turn64, const int32_t *wave_q30,
                        bool *saturated)
{
    switch (config->kind) {
    case PATH_SINE:
        return part_of_swing(config, sine_share_q31(rounded_turn32(phase_turn64)), 31, saturated);
    case PATH_WAVE:
        if (wave_q30 == NULL)
            return config->offset;
        return part_of_swing(config, wave_q30_at(wave_q30, rounded_turn32(phase_turn64)), 30, saturated);
    case PATH_MOVE:
        return part_of_swing(config, least_jerk_q31(phase_turn64), 31, saturated);
    default:
        return config->offset;
    }
}

static uint64_t add_up_to_end(uint64_t a, uint64_t b)
{
    return b > UINT64_MAX - a ? UINT64_MAX : a + b;
}

/* step x ticks, up to the end of the way. */
static uint64_t way_ahead_turn64(uint64_t step_turn64, uint32_t ticks_q16)
{
    uint64_t high = (step_turn64 >> 32) * ticks_q16;
    uint64_t low = ((uint32_t)step_turn64 * (uint64_t)ticks_q16) >> 16;
    return high >> 48 != 0 ? UINT64_MAX : add_up_to_end(high << 16, low);
}

uint64_t path_phase_ahead(uint64_t phase_turn64, uint64_t step_turn64, uint32_t ticks_q16)
{
    return add_up_to_end(phase_turn64, way_ahead_turn64(step_turn64, ticks_q16));
}

uint32_t path_least_jerk_q30(uint64_t phase_turn64)
{
    return (uint32_t)round_shift_i64(least_jerk_q31(phase_turn64), 1);
}

int32_t path_now(const struct path_config *config, const struct path_state *state, const int32_t *wave_q30,
                 bool *saturated)
{
    return value_at(config, state->phase_turn64, wave_q30, saturated);
}

uint32_t path_lead_left_q16(const struct path_state *state, uint32_t lead_ticks_q16)
{
    const uint64_t wait_q16 = (uint64_t)state->wait_ticks << 16;
    return wait_q16 < lead_ticks_q16 ? (uint32_t)(lead_ticks_q16 - wait_q16) : 0;
}

int32_t path_ahead(const struct path_config *config, const struct path_state *state, const int32_t *wave_q30,
                   int32_t lead_turn32, uint32_t lead_ticks_q16, bool *saturated)
{
    uint64_t phase_turn64 = state->phase_turn64;
    if (state->running == 0)
        return value_at(config, phase_turn64, wave_q30, saturated);
    if (config->kind == PATH_MOVE)
        phase_turn64 = path_phase_ahead(phase_turn64, config->step_turn64, path_lead_left_q16(state, lead_ticks_q16));
    else
        phase_turn64 += (uint64_t)(uint32_t)lead_turn32 << 32;
    return value_at(config, phase_turn64, wave_q30, saturated);
}

void path_run_on(const struct path_config *config, struct path_state *state)
{
    if (config->kind == PATH_MOVE)
        state->phase_turn64 = add_up_to_end(state->phase_turn64, config->step_turn64);
    else
        state->phase_turn64 += config->step_turn64;
}

bool path_advance(const struct path_config *config, struct path_state *state)
{
    if (state->running == 0)
        return false;
    if (state->wait_ticks != 0) {
        state->wait_ticks--;
        return false;
    }
    state->elapsed++;
    path_run_on(config, state);
    const bool arrived = config->kind == PATH_MOVE && state->phase_turn64 == UINT64_MAX;
    const bool ended = config->ticks != 0 ? state->elapsed >= config->ticks : arrived;
    if (ended)
        state->running = 0;
    return ended;
}
