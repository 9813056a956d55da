/* Fading plays: a play whose slack closes little by little along the way after a turn, as friction does (Dahl 1968),
 *     dz / d|v| = (sign(dv) - z) / (2 r),    fading play = v - r z.
 * It lags as a play of threshold r once it has gone on for a while; but where it turned it has then forgotten. */
#ifndef PHASELEAD_MODEL_FADING_H
#define PHASELEAD_MODEL_FADING_H

#include "operator.h"

/* z after the voltage has gone straight from `from` to `to`. */
double fading_step(double from, double to, double r, double z);

/* y[k] = sum w_j (fading play_j[v] - v) in um for v (n) in V, r (m) in V and w (m) in um/V; z (m) where they start at
 * v[0], and then where they end. */
PHASELEAD_EXPORT void stage_fading_plays(size_t n, const double *v, size_t m, const double *r, const double *w,
                                         double *z, double *y);

#endif
