#include "core/feedforward_tables.h"

#include "core/fixed.h"

#define GAIN_MIN_Q32 (((int64_t)1 << 29) + 1) /* 1/8 um/V: its inverse must fit q28 */
#define GAIN_MAX_Q32 ((int64_t)1 << 44)       /* 4096 um/V: beyond, q28 holds the inverse to less than 1e-5 */

/* c0 + c1 x + c2 x^2 */
static int64_t quadratic(const int64_t c[3], int32_t x_q24, bool *overflow)
{
    int64_t inner = sat_add_i64(c[1], mul_shift_i64(c[2], x_q24, 24, overflow), overflow);
    return sat_add_i64(c[0], mul_shift_i64(inner, x_q24, 24, overflow), overflow);
}

/* Where the slope c1 + 2 c2 x changes sign between low and high, to 1 LSB; `high` when it does not. */
static int32_t vertex_q24(const int64_t c[3], int32_t low_q24, int32_t high_q24, bool *overflow)
{
    const int64_t slope[3] = {c[1], sat_add_i64(c[2], c[2], overflow), 0};
    bool rising = quadratic(slope, low_q24, overflow) > 0;
    for (int halvings = 0; halvings < 31 && low_q24 < high_q24; halvings++) {
        int32_t middle_q24 = low_q24 + (high_q24 - low_q24) / 2;
        if ((quadratic(slope, middle_q24, overflow) > 0) == rising)
            low_q24 = middle_q24 + 1;
        else
            high_q24 = middle_q24;
    }
    return high_q24;
}

/* Least and largest value on [low, high]: at an end or at the vertex. False when 64 bits cannot hold them. */
static bool extremes(const int64_t c[3], int32_t low_q24, int32_t high_q24, int64_t *least, int64_t *largest)
{
    bool overflow = false;
    const int64_t values[3] = {quadratic(c, low_q24, &overflow), quadratic(c, high_q24, &overflow),
                               quadratic(c, vertex_q24(c, low_q24, high_q24, &overflow), &overflow)};
    *least = *largest = values[0];
    for (int i = 1; i < 3; i++) {
        *least = values[i] < *least ? values[i] : *least;
        *largest = values[i] > *largest ? values[i] : *largest;
    }
    return !overflow;
}

/* K(um) um. K is at most 2^44 and um below 128 V, so nothing overflows once the gain has been checked. */
static int64_t range_q32(const int64_t a_q32[3], int32_t swing_q24)
{
    bool overflow = false;
    return mul_shift_i64(quadratic(a_q32, swing_q24, &overflow), swing_q24, 24, &overflow);
}

/* Solves K(um) um = R on [low, high], where the left side rises: bisection, then the nearer neighbour. */
static int32_t swing_for_range_q24(const int64_t a_q32[3], int64_t wanted_q32, int32_t low_q24, int32_t high_q24)
{
    for (int halvings = 0; halvings < 32 && high_q24 - low_q24 > 1; halvings++) {
        int32_t middle_q24 = low_q24 + (high_q24 - low_q24) / 2;
        if (range_q32(a_q32, middle_q24) <= wanted_q32)
            low_q24 = middle_q24;
        else
            high_q24 = middle_q24;
    }
    int64_t below = wanted_q32 - range_q32(a_q32, low_q24), above = range_q32(a_q32, high_q24) - wanted_q32;
    return above < below ? high_q24 : low_q24;
}

/* theta(um, f) = b0 + um (b1 + b4 um) + f (b2 + b3 um + b5 f) in turns. False beyond half a turn. */
static bool lead(const int64_t b_q40[6], int32_t swing_q24, int32_t f_q16, int32_t *lead_turn32)
{
    bool overflow = false;
    const int64_t by_swing[3] = {b_q40[0], b_q40[1], b_q40[4]};
    int64_t cross = mul_shift_i64(b_q40[3], swing_q24, 24, &overflow);
    int64_t by_f = mul_shift_i64(b_q40[5], f_q16, 16, &overflow);
    by_f = sat_add_i64(sat_add_i64(b_q40[2], cross, &overflow), by_f, &overflow);
    int64_t theta_q40 =
        sat_add_i64(quadratic(by_swing, swing_q24, &overflow), mul_shift_i64(by_f, f_q16, 16, &overflow), &overflow);
    *lead_turn32 = sat_i32(round_shift_i64(theta_q40, 8), &overflow);
    return !overflow;
}

/* K must be representable and K(um) um strictly rising everywhere in the rectangle, not only at the nodes. */
static enum feedforward_verdict check(const struct feedforward_model *model)
{
    if (model->swing_min_q24 < 0 || model->swing_min_q24 >= model->swing_max_q24 || model->f_min_q16 < 0 ||
        model->f_min_q16 >= model->f_max_q16)
        return FF_RECTANGLE_EMPTY;
    int64_t least, largest;
    const int64_t *a = model->a_q32;
    if (!extremes(a, model->swing_min_q24, model->swing_max_q24, &least, &largest) || least < GAIN_MIN_Q32 ||
        largest > GAIN_MAX_Q32 || range_q32(a, model->swing_max_q24) >= (int64_t)INT32_MAX * 65536)
        return FF_GAIN_OUT_OF_RANGE;
    bool overflow = false;
    const int64_t rise[3] = {a[0], sat_add_i64(a[1], a[1], &overflow),
                             sat_add_i64(a[2], sat_add_i64(a[2], a[2], &overflow), &overflow)};
    if (!extremes(rise, model->swing_min_q24, model->swing_max_q24, &least, &largest) || overflow || least <= 0)
        return FF_NOT_MONOTONE;
    return FF_OK;
}

/* Node i of n between two q16 values, as q32; n = 2^bits, so nothing is lost. */
static int64_t node_q32(int32_t low_q16, int32_t high_q16, int node, unsigned bits)
{
    return (int64_t)low_q16 * 65536 + ((int64_t)high_q16 - low_q16) * node * (1 << (16 - bits));
}

enum feedforward_verdict feedforward_expand(const struct feedforward_model *model, struct feedforward_tables *tables)
{
    enum feedforward_verdict verdict = check(model);
    if (verdict != FF_OK)
        return verdict;
    tables->range_min_q16 = (int32_t)round_shift_i64(range_q32(model->a_q32, model->swing_min_q24), 16);
    tables->range_max_q16 = (int32_t)round_shift_i64(range_q32(model->a_q32, model->swing_max_q24), 16);
    tables->f_min_q16 = model->f_min_q16;
    tables->f_max_q16 = model->f_max_q16;
    if (tables->range_min_q16 >= tables->range_max_q16) /* rises by less than q16 shows */
        return FF_NOT_MONOTONE;
    const uint64_t one_q63 = (uint64_t)1 << 63;
    tables->range_inverse_q63 = one_q63 / (uint64_t)(tables->range_max_q16 - tables->range_min_q16);
    tables->f_inverse_q63 = one_q63 / (uint64_t)(tables->f_max_q16 - tables->f_min_q16);

    for (int i = 0; i < FF_RANGE_NODES; i++) {
        int64_t wanted_q32 = node_q32(tables->range_min_q16, tables->range_max_q16, i, 6);
        int32_t swing_q24 = swing_for_range_q24(model->a_q32, wanted_q32, model->swing_min_q24, model->swing_max_q24);
        bool overflow = false;
        int64_t gain_q32 = quadratic(model->a_q32, swing_q24, &overflow);
        tables->swing_q24[i] = swing_q24;
        tables->inverse_gain_q28[i] = (int32_t)((((int64_t)1 << 60) + gain_q32 / 2) / gain_q32);
        for (int j = 0; j < FF_FREQUENCY_NODES; j++) {
            int64_t f_q32 = node_q32(tables->f_min_q16, tables->f_max_q16, j, 4);
            if (!lead(model->b_q40, swing_q24, (int32_t)round_shift_i64(f_q32, 16), &tables->lead_turn32[j][i]))
                return FF_LEAD_OUT_OF_RANGE;
        }
    }
    return FF_OK;
}
