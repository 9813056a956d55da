#include "core/path.h"

#include <stddef.h>

#include "core/fixed.h"
#include "core/sine.h"

#define ONE_Q30 ((int64_t)1 << 30)
#define ONE_Q31 ((int64_t)1 << 31)
#define HALF_TURN32 0x80000000u /* rounds turn64 to turn32 */

void path_start(struct path_state *state)
{
    state->phase_turn64 = 0;
    state->elapsed = 0;
    state->running = 1;
    state->reserved = 0;
}

/* offset + swing x share / 2^bits. |share| <= 2^31, so the product stays within 2^62. */
static inline int32_t part_of_swing(const struct path_config *config, int64_t share, unsigned bits, bool *saturated)
{
    return sat_i32(config->offset + floor_shift_i64(config->swing * share + ((int64_t)1 << (bits - 1)), bits),
                   saturated);
}

/* offset + swing (1 + sine) / 2, rounded as above: the upper mean of the swing and its product with the sine. */
static inline int32_t part_by_sine(const struct path_config *config, int32_t sine_q30, bool *saturated)
{
    const int32_t swing = config->swing;
    if (swing == INT32_MIN) /* -swing does not fit */
        return part_of_swing(config, ONE_Q30 + sine_q30, 31, saturated);
    int32_t product = (int32_t)floor_shift_i64((int64_t)swing * sine_q30, 30);
    return sat_add_i32(config->offset, upper_mean_i32(swing, product), saturated);
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

static inline uint32_t rounded_turn32(uint64_t phase_turn64)
{
    return (uint32_t)((phase_turn64 + HALF_TURN32) >> 32);
}

/* It begins at its lowest, a quarter turn behind a sine. */
static inline int32_t sine_at(const struct path_config *config, uint32_t phase_turn32, bool *saturated)
{
    return part_by_sine(config, sine_q30(phase_turn32 - 0x40000000u), saturated);
}

static inline int32_t wave_at(const struct path_config *config, uint32_t phase_turn32, const int32_t *wave_q30,
                              bool *saturated)
{
    if (wave_q30 == NULL)
        return config->offset;
    return part_of_swing(config, wave_q30_at(wave_q30, phase_turn32), 30, saturated);
}

static int32_t value_at(const struct path_config *config, uint64_t phase_turn64, const int32_t *wave_q30,
                        bool *saturated)
{
    switch (config->kind) {
    case PATH_SINE:
        return sine_at(config, rounded_turn32(phase_turn64), saturated);
    case PATH_WAVE:
        return wave_at(config, rounded_turn32(phase_turn64), wave_q30, saturated);
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

int32_t path_now(const struct path_config *config, const struct path_state *state, const int32_t *wave_q30,
                 bool *saturated)
{
    return value_at(config, state->phase_turn64, wave_q30, saturated);
}

/* The lead has no part of a turn32, so that both are rounded alike. Flat: it is what the tables' tick is made of. */
__attribute__((flatten)) struct path_pair path_now_and_led(const struct path_config *config,
                                                           const struct path_state *state, const int32_t *wave_q30,
                                                           int32_t lead_turn32, bool *saturated)
{
    uint32_t now_turn32 = rounded_turn32(state->phase_turn64);
    uint32_t led_turn32 = now_turn32 + (state->running != 0 ? (uint32_t)lead_turn32 : 0);
    if (config->kind == PATH_SINE)
        return (struct path_pair){sine_at(config, now_turn32, saturated), sine_at(config, led_turn32, saturated)};
    return (struct path_pair){wave_at(config, now_turn32, wave_q30, saturated),
                              wave_at(config, led_turn32, wave_q30, saturated)};
}

int32_t path_ahead(const struct path_config *config, const struct path_state *state, const int32_t *wave_q30,
                   int32_t lead_turn32, uint32_t lead_ticks_q16, bool *saturated)
{
    uint64_t phase_turn64 = state->phase_turn64;
    if (state->running == 0)
        return value_at(config, phase_turn64, wave_q30, saturated);
    if (config->kind == PATH_MOVE)
        phase_turn64 = add_up_to_end(phase_turn64, way_ahead_turn64(config->step_turn64, lead_ticks_q16));
    else
        phase_turn64 += (uint64_t)(uint32_t)lead_turn32 << 32;
    return value_at(config, phase_turn64, wave_q30, saturated);
}

static bool ends(struct path_state *state, bool ended)
{
    if (ended)
        state->running = 0;
    return ended;
}

bool path_advance(const struct path_config *config, struct path_state *state)
{
    if (state->running == 0)
        return false;
    const uint64_t elapsed = state->elapsed + 1, phase_turn64 = state->phase_turn64;
    const bool in_time = config->ticks != 0 && elapsed >= config->ticks;
    state->elapsed = elapsed;
    if (config->kind == PATH_MOVE) {
        state->phase_turn64 = add_up_to_end(phase_turn64, config->step_turn64);
        return ends(state, config->ticks != 0 ? in_time : state->phase_turn64 == UINT64_MAX);
    }
    state->phase_turn64 = phase_turn64 + config->step_turn64;
    return ends(state, in_time);
}
