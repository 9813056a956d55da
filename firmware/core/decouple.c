#include "core/decouple.h"

#include <stddef.h>

#include "core/fixed.h"

static int32_t row_q16(const int32_t share_q28[DECOUPLE_AXES], const int32_t values_q16[DECOUPLE_AXES], bool *saturated)
{
    int64_t sum_q44 = 0;
    for (unsigned j = 0; j < DECOUPLE_AXES; j++)
        sum_q44 = sat_add_i64(sum_q44, (int64_t)share_q28[j] * values_q16[j], saturated);
    return sat_i32(round_shift_i64(sum_q44, 28), saturated);
}

void decouple(const struct decoupling *decoupling, uint32_t moving, int32_t values_q16[DECOUPLE_AXES], bool *saturated)
{
    if (decoupling == NULL || moving >= 1u << DECOUPLE_AXES)
        return;
    int32_t seen_q16[DECOUPLE_AXES];
    for (unsigned i = 0; i < DECOUPLE_AXES; i++)
        seen_q16[i] = moving >> i & 1u ? values_q16[i] : 0;
    for (unsigned i = 0; i < DECOUPLE_AXES; i++)
        if (moving >> i & 1u)
            values_q16[i] = row_q16(decoupling->share_q28[moving][i], seen_q16, saturated);
}
