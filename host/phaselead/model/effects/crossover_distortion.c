#include "operator.h"

/* Where the drive d of an output stage stands off its voltage v inside the dead zone of +-half, z = d - v (n,), when
 * the loop around it brings v to x: tau dd/dt = x - v, `ratio` = step/tau, by the trapezoidal rule. Settled at x[0]. */
PHASELEAD_EXPORT void stage_crossover(size_t n, const double *x, double half, double ratio, double *z);

void stage_crossover(size_t n, const double *x, double half, double ratio, double *z)
{
    double d = n ? x[0] : 0.0, v = d, before = d, part = ratio / 2;
    for (size_t k = 0; k < n; k++) {
        double open = d + part * (before + x[k] - v); /* d is this less part times the new v */
        double off = open - part * v - v;
        if (off > half) {
            v = (open - half) / (1 + part);
        } else if (off < -half) {
            v = (open + half) / (1 + part);
        }
        d = open - part * v;
        before = x[k];
        z[k] = d - v;
    }
}
