/* Modes of the mechanics whose poles may move a little with the levels of the actuators, in doubles.
 *
 * A mode is s' = p (1 - sum_j drop_j level_j) s + x with a complex pole p. Its input runs straight between rows and its
 * pole stands still over each step; shifts of a few per cent are meant, and their third order is left out. */
#ifndef PHASELEAD_MODEL_MODE_BANK_H
#define PHASELEAD_MODEL_MODE_BANK_H

#include "operator.h"

struct stage_mode { /* per step: z = p step; transition exp(z); weights of the row before and the new one; slopes in p
                     */
    double pole_re, pole_im, z_re, z_im;
    double transition_re, transition_im;
    double old_re, old_im, new_re, new_im;
    double old_slope_re, old_slope_im, new_slope_re, new_slope_im;
    double size, size_squared; /* abs(p) */
};

/* Mode r of x[k]: abs(p) s into out[(k m + r) 2], real and imaginary part, settled in the first row; with `slope` (or
 * NULL) also abs(p)^2 ds/dp. `level` (n, axes) and `drop` (m, axes, 2) may be NULL with axes = 0; `state` is room for
 * 4 m doubles. */
PHASELEAD_EXPORT void stage_modes(size_t n, const double *x, double step, size_t m, const struct stage_mode *modes,
                                  size_t axes, const double *level, const double *drop, double *state, double *out,
                                  double *slope);

#endif
