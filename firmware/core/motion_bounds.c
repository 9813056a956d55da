#include "core/motion_bounds.h"

#include "core/fixed.h"

#define FRACTION_BITS 24

struct ratio_q10 { /* in 1024ths, rounded up */
    uint64_t value_q10;
};

static const struct ratio_q10 MOVE_V = {1920}, MOVE_A = {5913}, MOVE_J = {61440};      /* 15/8, 10/sqrt(3), 60 */
static const struct ratio_q10 SINE_V = {3217}, SINE_A = {20213}, SINE_J = {127002};    /* pi, 2 pi^2, 4 pi^3 */
static const struct ratio_q10 TWICE_V = {3840}, THRICE_V = {5760}, THRICE_A = {17739}; /* of MOVE_V and MOVE_A */

static uint64_t sum(uint64_t a, uint64_t b)
{
    return b > UINT64_MAX - a ? UINT64_MAX : a + b;
}

/* value x factor / 2^bits, rounded up. */
static uint64_t scaled(uint64_t value, uint64_t factor, unsigned bits)
{
    uint64_t low, high = mul_wide_u64(factor, value, &low);
    return high >> bits != 0 ? UINT64_MAX : sum(high << (64 - bits) | low >> bits, 1);
}

static uint64_t times(struct ratio_q10 ratio, uint64_t value)
{
    return scaled(value, ratio.value_q10, 10);
}

/* value x step / 2^64, rounded up. */
static uint64_t per_tick(uint64_t value, uint64_t step_turn64)
{
    uint64_t low;
    return sum(mul_wide_u64(value, step_turn64, &low), 1);
}

static uint64_t fine(uint64_t way)
{
    return way >> (64 - FRACTION_BITS) != 0 ? UINT64_MAX : way << FRACTION_BITS;
}

static struct motion_bounds derivatives(uint64_t way, uint64_t step_turn64, struct ratio_q10 v, struct ratio_q10 a,
                                        struct ratio_q10 j)
{
    const uint64_t first = per_tick(fine(way), step_turn64), second = per_tick(first, step_turn64);
    return (struct motion_bounds){times(v, first), times(a, second), times(j, per_tick(second, step_turn64))};
}

struct motion_bounds motion_of_move(uint64_t way, uint64_t step_turn64)
{
    return way == 0 ? (struct motion_bounds){0, 0, 0} : derivatives(way, step_turn64, MOVE_V, MOVE_A, MOVE_J);
}

struct path_span path_span(const struct path_config *config)
{
    const int64_t begin = config->offset;
    const int64_t end = config->kind == PATH_HOLD ? begin : begin + config->swing;
    return (struct path_span){begin < end ? begin : end, begin < end ? end : begin};
}

struct motion_bounds motion_of_path(const struct path_config *config, uint32_t steepest_q30)
{
    const uint64_t way = magnitude_i64(config->swing);
    if (way == 0 || config->kind == PATH_HOLD)
        return (struct motion_bounds){0, 0, 0};
    if (config->kind == PATH_MOVE)
        return motion_of_move(way, config->step_turn64);
    if (config->kind == PATH_SINE)
        return derivatives(way, config->step_turn64, SINE_V, SINE_A, SINE_J);
    /* 1024 points a turn: q30 a point is q20 a turn */
    return (struct motion_bounds){scaled(per_tick(fine(way), config->step_turn64), steepest_q30, 20), 0, 0};
}

uint64_t span_apart(const struct path_span *a, const struct path_span *b)
{
    const uint64_t up = magnitude_i64(b->high - a->low), down = magnitude_i64(a->high - b->low);
    return up > down ? up : down;
}

static uint64_t larger(uint64_t a, uint64_t b)
{
    return a > b ? a : b;
}

struct motion_bounds motion_of_join(const struct motion_bounds *before, const struct motion_bounds *after,
                                    uint64_t apart, uint64_t step_turn64)
{
    const struct motion_bounds mix = motion_of_move(apart, step_turn64);
    const uint64_t both_v = per_tick(sum(before->velocity, after->velocity), step_turn64);
    const uint64_t both_a = per_tick(sum(before->acceleration, after->acceleration), step_turn64);
    struct motion_bounds joined = {.velocity = sum(larger(before->velocity, after->velocity), mix.velocity)};
    joined.acceleration = sum(larger(before->acceleration, after->acceleration), mix.acceleration);
    joined.acceleration = sum(joined.acceleration, times(TWICE_V, both_v));
    joined.jerk = sum(larger(before->jerk, after->jerk), mix.jerk);
    joined.jerk = sum(joined.jerk, times(THRICE_V, both_a));
    joined.jerk = sum(joined.jerk, times(THRICE_A, per_tick(both_v, step_turn64)));
    return joined;
}

static bool is_within(uint64_t value, uint64_t limit)
{
    return limit == 0 || value <= limit;
}

bool motion_is_within(const struct motion_bounds *motion, const struct motion_bounds *limits)
{
    return is_within(motion->velocity, limits->velocity) && is_within(motion->acceleration, limits->acceleration) &&
           is_within(motion->jerk, limits->jerk);
}

uint32_t motion_steepest_q30(const int32_t *wave_q30)
{
    uint32_t steepest = 0;
    for (unsigned i = 0; i < WAVE_POINTS; i++) {
        const int64_t step = (int64_t)wave_q30[(i + 1) % WAVE_POINTS] - wave_q30[i];
        const uint32_t size = (uint32_t)magnitude_i64(step);
        steepest = size > steepest ? size : steepest;
    }
    return steepest;
}
