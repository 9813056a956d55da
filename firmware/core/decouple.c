#include "core/decouple.h"

#include <stddef.h>

#include "core/fixed.h"

/* Shares are below 4: 64 bits hold the sum of three products whatever the values. */
static inline int32_t row_q16(const int32_t share_q28[DECOUPLE_AXES], int32_t x_q16, int32_t y_q16, int32_t z_q16,
                              bool *saturated)
{
    int64_t sum_q44 = (int64_t)share_q28[0] * x_q16 + (1 << 27); /* the half that rounds */
    sum_q44 += (int64_t)share_q28[1] * y_q16;
    sum_q44 += (int64_t)share_q28[2] * z_q16;
    return sat_i32(floor_shift_i64(sum_q44, 28), saturated);
}

/* An axis that does not move has no share in the others and all of its own: it stays as it is. */
void decouple(const struct decoupling *decoupling, uint32_t moving, int32_t values_q16[DECOUPLE_AXES], bool *saturated)
{
    if (decoupling == NULL || (moving & (moving - 1)) == 0 || moving >= 1u << DECOUPLE_AXES) /* one axis is itself */
        return;
    const int32_t (*share_q28)[DECOUPLE_AXES] = decoupling->share_q28[moving];
    const int32_t x_q16 = values_q16[0], y_q16 = values_q16[1], z_q16 = values_q16[2];
    values_q16[0] = row_q16(share_q28[0], x_q16, y_q16, z_q16, saturated);
    values_q16[1] = row_q16(share_q28[1], x_q16, y_q16, z_q16, saturated);
    values_q16[2] = row_q16(share_q28[2], x_q16, y_q16, z_q16, saturated);
}
