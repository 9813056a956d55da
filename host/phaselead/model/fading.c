#include "fading.h"

#include <math.h>

double fading_step(double from, double to, double r, double z)
{
    if (from == to) {
        return z;
    }
    double end = to > from ? 1.0 : -1.0;
    return end + (z - end) * exp(-fabs(to - from) / (2.0 * r));
}

void stage_fading_plays(size_t n, const double *v, size_t m, const double *r, const double *w, double *z, double *y)
{
    for (size_t k = 0; k < n; k++) {
        double lag = 0.0;
        for (size_t j = 0; j < m; j++) {
            z[j] = k ? fading_step(v[k - 1], v[k], r[j], z[j]) : z[j];
            lag += w[j] * r[j] * z[j];
        }
        y[k] = -lag;
    }
}
