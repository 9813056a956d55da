#include "operator.h"

#include <math.h>

/* Friction along a path: over each row y relaxes towards the row's level in the direction of travel,
 *     dy / d|q| = (sign(dq) level - y) / reach,
 * exactly for a straight row; it stands still with q. From 0; q (n), level and y (n, m). */
PHASELEAD_EXPORT void stage_friction(size_t n, const double *q, double reach, size_t m, const double *level, double *y);

void stage_friction(size_t n, const double *q, double reach, size_t m, const double *level, double *y)
{
    for (size_t j = 0; n && j < m; j++) {
        y[j] = 0.0;
    }
    for (size_t k = 1; k < n; k++) {
        double moved = q[k] - q[k - 1];
        double taken = -expm1(-fabs(moved) / reach);
        double side = moved < 0.0 ? -1.0 : 1.0;
        for (size_t j = 0; j < m; j++) {
            double before = y[(k - 1) * m + j];
            y[k * m + j] = before + taken * (side * level[k * m + j] - before);
        }
    }
}
