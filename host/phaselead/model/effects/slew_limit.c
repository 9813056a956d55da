#include <math.h>

#include "operator.h"

#define MOST_STEPS 60 /* Newton's; three do unless far beyond the limit */
#define NEAR 1e-6     /* of z: a step after such a one would be 1e-12 */
#define SHARP 1e-12   /* of the way of a row: a lag that has no digits left */
#define SLOW 0.1      /* of the limit: five terms of artanh then have 11 digits */

/* p >= 0 with rise p + lag (artanh(p) - p) = far, that is a little below far / rise. */
static double slow_part(double far, double rise, double lag)
{
    double p = far / rise;
    for (int i = 0; i < 3; i++) {
        double s = p * p, series = s * (1.0 / 3 + s * (1.0 / 5 + s * (1.0 / 7 + s * (1.0 / 9 + s / 11))));
        double slope = rise + lag * s * (1 + s * (1 + s * (1 + s * (1 + s))));
        p -= (p * (rise + lag * series) - far) / slope;
    }
    return p;
}

/* The same by z = artanh(p): rise tanh(z) + lag (z - tanh(z)) = far. Its slope is rise at 0 and lag far out, and
 * changes one way only: from the nearer of both tangents, Newton's steps come from one side. */
static double part(double far, double rise, double lag)
{
    if (far < SLOW * rise && lag < rise)
        return slow_part(far, rise, lag);
    double at_rest = far / rise, far_out = (far - rise) / lag + 1;
    double z = lag < rise ? fmax(at_rest, far_out) : fmin(at_rest, far_out), p = 1;
    for (int i = 0; i < MOST_STEPS; i++) {
        p = tanh(z);
        double step = (far - rise * p - lag * (z - p)) / (rise + (lag - rise) * p * p);
        z += step;
        p += (1 - p * p) * step;
        if (fabs(step) <= NEAR * z)
            break;
    }
    return p;
}

/* y follows x, from x[0] on, by at most `rise` a row: x - y = lag (artanh(p) - p), p the part of the rate that is
 * used. `lag` = rate times the time constant of the loop; 0 is a sharp limit. */
PHASELEAD_EXPORT void stage_slew(size_t n, const double *x, double rise, double lag, double *y);

void stage_slew(size_t n, const double *x, double rise, double lag, double *y)
{
    double at = n ? x[0] : 0.0;
    for (size_t k = 0; k < n; k++) {
        double far = x[k] - at;
        if (lag > SHARP * rise)
            at += copysign(rise * part(fabs(far), rise, lag), far);
        else
            at = far > rise ? at + rise : far < -rise ? at - rise : x[k];
        y[k] = at;
    }
}
