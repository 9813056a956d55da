#include "operator.h"

#include <math.h>
#include <stdbool.h>

/* y[k] = sum w_j play_j[v] with thresholds scale[k] r_j that change from row to row; the plays start at p. Where a
 * threshold shrinks, what is held back beyond it is let go at once but for the share `held`, which is let go only as
 * the voltage moves, by as much. */
PHASELEAD_EXPORT void stage_scaled_plays(size_t n, const double *v, const double *scale, size_t m, const double *r,
                                         const double *w, double held, double *p, double *y);

static bool constant(size_t n, const double *x)
{
    size_t same = 1;
    while (same < n && x[same] == x[0]) {
        same++;
    }
    return same >= n;
}

void stage_scaled_plays(size_t n, const double *v, const double *scale, size_t m, const double *r, const double *w,
                        double held, double *p, double *y)
{
    if (constant(n, scale)) { /* nothing is ever held back beyond a threshold */
        stage_weighed_plays(n, v, n ? scale[0] : 1.0, m, r, w, p, y);
        return;
    }
    for (size_t k = 0; k < n; k++) {
        double sum = 0.0;
        double before = v[k > 0 ? k - 1 : 0];
        double moved = fabs(v[k] - before);
        for (size_t j = 0; j < m; j++) {
            double kept = k > 0 ? fabs(before - p[j]) - moved : 0.0;
            double reach = scale[k] * r[j];
            reach += held * fmax(kept - reach, 0.0);
            double high = v[k] + reach;
            double low = v[k] - reach;
            double q = p[j] < high ? p[j] : high;
            p[j] = q > low ? q : low;
            sum += w[j] * p[j];
        }
        y[k] = sum;
    }
}
