/* First- and second-order filters that effects share, in doubles. The row x[0] is how things stood before. */
#ifndef PHASELEAD_MODEL_FILTERS_H
#define PHASELEAD_MODEL_FILTERS_H

#include "operator.h"

struct stage_lag { /* 1/(tau s + 1) for an input that runs straight between rows: s' = s + old (x - s) + new (x' - s) */
    double old, new, gain;
};

/* y[k] = sum gain_j s_j[k], each settled at x[0] in the first row. `s` is room for m states. */
PHASELEAD_EXPORT void stage_lags(size_t n, const double *x, size_t m, const struct stage_lag *lags, double *s,
                                 double *y);

/* b and a (3 each, a[0] = 1) as in y[k] = sum b_i x[k-i] - sum a_i y[k-i], at rest with x = x[0] = y: b and a have a
 * gain of 1 at 0 Hz. */
PHASELEAD_EXPORT void stage_second_order(size_t n, const double *x, const double *b, const double *a, double *y);

struct stage_share { /* of a motion, carried by a second-order system of gain 1; b and a as above */
    double share, b[3], a[3];
};

/* y (n, k) = x + sum share (system of x - x): k columns of x, row after row, each at rest in the first. `states` is
 * room for 2 m k. */
PHASELEAD_EXPORT void stage_behind_modes(size_t n, size_t k, const double *x, size_t m, const struct stage_share *modes,
                                         double *states, double *y);

/* What a second-order system y of x leaves of `measured` at the ascending `rows`, e = measured - y, and its change with
 * a later answer, d = dy/dt: the mean of e e, e d and d d, each about the means of e and d. */
PHASELEAD_EXPORT void stage_second_order_residual(size_t n, const double *x, const double *measured, const double *b,
                                                  const double *a, double step, size_t n_rows, const size_t *rows,
                                                  double *means);

#endif
