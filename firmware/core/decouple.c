#include "core/decouple.h"

#include <stddef.h>

#include "core/fixed.h"

/* Shares are below 4: 64 bits hold the sum of three products whatever the values. */
static int32_t row_q16(const int32_t share_q28[DECOUPLE_AXES], const int32_t values_q16[DECOUPLE_AXES], bool *saturated)
{
    int64_t sum_q44 = 0;
    for (unsigned from = 0; from < DECOUPLE_AXES; from++)
        sum_q44 += (int64_t)share_q28[from] * values_q16[from];
    return sat_i32(round_shift_i64(sum_q44, 28), saturated);
}

static bool is_one_or_none(uint32_t set)
{
    return (set & (set - 1)) == 0;
}

/* An axis that does not move has no share in the others and all of its own: it stays as it is. */
void decouple(const struct decoupling *decoupling, uint32_t moving, int32_t values_q16[DECOUPLE_AXES], bool *saturated)
{
    if (decoupling == NULL || is_one_or_none(moving) || moving >= 1u << DECOUPLE_AXES)
        return;
    int32_t decoupled_q16[DECOUPLE_AXES];
    for (unsigned to = 0; to < DECOUPLE_AXES; to++)
        decoupled_q16[to] = row_q16(decoupling->share_q28[moving][to], values_q16, saturated);
    for (unsigned axis = 0; axis < DECOUPLE_AXES; axis++)
        values_q16[axis] = decoupled_q16[axis];
}

void couple(const int32_t coupling_q28[DECOUPLE_AXES][DECOUPLE_AXES], uint32_t moving,
            int32_t values_q16[DECOUPLE_AXES])
{
    bool beyond = false;
    int32_t motions_q16[DECOUPLE_AXES];
    for (unsigned axis = 0; axis < DECOUPLE_AXES; axis++)
        motions_q16[axis] = (moving >> axis & 1u) != 0 ? values_q16[axis] : 0;
#pragma GCC unroll 1
    for (unsigned axis = 0; axis < DECOUPLE_AXES; axis++)
        if ((moving >> axis & 1u) != 0)
            values_q16[axis] = row_q16(coupling_q28[axis], motions_q16, &beyond);
}
