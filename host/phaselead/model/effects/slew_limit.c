#include "operator.h"

/* y follows x, from x[0] on, by at most `rise` a row. */
PHASELEAD_EXPORT void stage_slew(size_t n, const double *x, double rise, double *y);

void stage_slew(size_t n, const double *x, double rise, double *y)
{
    double at = n ? x[0] : 0.0;
    for (size_t k = 0; k < n; k++) {
        double far = x[k] - at;
        at = far > rise ? at + rise : far < -rise ? at - rise : x[k];
        y[k] = at;
    }
}
