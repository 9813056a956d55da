/* The play operator and the time-domain stage model, in doubles.
 *
 * A play of threshold r follows its input v with a slack of r on either side:
 *     p_k = max(v_k - r, min(v_k + r, p_{k-1}))                (Kuhnen 2003, eq. 5)
 * Voltages in V, thresholds in V, weights in um/V. Nothing is allocated, nothing is kept between calls:
 * the plays come in through `p` and leave through `p`, so that a record can be continued. */
#ifndef PHASELEAD_MODEL_OPERATOR_H
#define PHASELEAD_MODEL_OPERATOR_H

#include <stddef.h>

#if defined(_WIN32)
#define PHASELEAD_EXPORT __declspec(dllexport)
#else
#define PHASELEAD_EXPORT __attribute__((visibility("default")))
#endif

/* v[k] = u at (k - delay) samples, linearly interpolated; u stood at `before` up to and including sample -1. delay >=
 * 0.
 *
 * Straight lines between rows are right for foreign records, whose voltage was sampled from something smooth. A DAC
 * that holds its value differs by half a sample of lag, which a fit puts into the delay. */
PHASELEAD_EXPORT void stage_delay(size_t n, const double *u, double before, double delay, double *v);

/* Play j after sample rows[i] into out[i * m + j]; rows ascend. Runs through all n samples of v. */
PHASELEAD_EXPORT void stage_plays(size_t n, const double *v, size_t m, const double *r, double *p, size_t n_rows,
                                  const size_t *rows, double *out);

struct stage_record { /* a voltage, the rows at which it turns round (row 0 among them), and the rows that count */
    size_t n;
    const double *u;
    double before; /* the voltage up to row -1 */
    size_t n_turns;
    const size_t *turns;
    size_t n_rows;
    const size_t *rows;
    const double *x; /* positions at those rows */
};

struct stage_density { /* a play at p weighs 1 + tilt s - taper s^2, s = (p - middle) / half within -1..1 */
    double tilt, taper, middle, half;
    double at_zero; /* what a play adds per unit of weight that stands at 0 V: taken off */
};

struct stage_basis { /* segments from low to high, and where 0 V stands in each; plays and fading plays (fading.h), and
                        where each rests: of plays, what they add there */
    size_t n_segments;
    const double *low, *high, *segment_rest;
    size_t n_plays;
    const double *r, *play_rest;
    struct stage_density density;
    size_t n_fading;
    const double *fading_r, *fading_rest;
};

/* What a unit slope of every segment, play and fading play adds to the position, then 1 and x, into out (n_rows,
 * n_segments + n_plays + n_fading + 2), for a voltage late by `delay` samples as in stage_delay. The plays start at `p`
 * and the fading ones at `z`, which are overwritten. */
PHASELEAD_EXPORT void stage_columns(const struct stage_record *record, double delay, const struct stage_basis *basis,
                                    double *p, double *z, double *out);

/* y[k] = sum w_j play_j[v] with thresholds scale r_j; the plays start and end at p.
 *
 * Plays whose thresholds ascend and of which none has lost touch with its neighbour move in turn: on the way from one
 * turning point of v to the next the smaller ones come first, and those that move add up to a straight line in v. So a
 * row costs what moves in it anew, not m steps. Plays that start out of touch, or whose thresholds do not ascend, are
 * stepped one by one. v must be finite.
 */
PHASELEAD_EXPORT void stage_weighed_plays(size_t n, const double *v, double scale, size_t m, const double *r,
                                          const double *w, double *p, double *y);

struct stage_operator {
    double gain;
    size_t n_plays;
    const double *play_r, *play_w;
    struct stage_density density;
    size_t n_deadzones;
    const double *deadzone_d, *deadzone_s;
};

/* Sizes of the structures, by which a caller knows that it means the same as this build. */
PHASELEAD_EXPORT int stage_operator_size(void);
PHASELEAD_EXPORT int stage_basis_size(void);

/* x[k] = gain v + sum w_j read(play_j[v]) + sum s_j max(v - d_j, 0), read being what the density makes of a play; the
 * offset is the caller's. */
PHASELEAD_EXPORT void stage_response(const struct stage_operator *op, size_t n, const double *v, double *p, double *x);

#endif
