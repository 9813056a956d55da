#include "mode_bank.h"

struct complex_pair {
    double re, im;
};

static inline struct complex_pair times(double ar, double ai, double br, double bi)
{
    return (struct complex_pair){ar * br - ai * bi, ar * bi + ai * br};
}

/* Relative drop of a pole at one row. */
static inline struct complex_pair dropped(size_t axes, const double *level, const double *drop)
{
    struct complex_pair sum = {0.0, 0.0};
    for (size_t j = 0; j < axes; j++) {
        sum.re += drop[2 * j] * level[j];
        sum.im += drop[2 * j + 1] * level[j];
    }
    return sum;
}

/* s = -x/p and ds/dp = x/p^2: how a mode stands that was held at x for ever. */
static void settle(double x, const struct stage_mode *mode, struct complex_pair drop, double *s, double *e)
{
    struct complex_pair p = times(mode->pole_re, mode->pole_im, 1.0 - drop.re, -drop.im);
    double square = p.re * p.re + p.im * p.im;
    struct complex_pair inverse = {p.re / square, -p.im / square};
    s[0] = -x * inverse.re;
    s[1] = -x * inverse.im;
    struct complex_pair slope = times(inverse.re, inverse.im, -s[0], -s[1]);
    e[0] = slope.re;
    e[1] = slope.im;
}

/* exp(-z drop) to third order. */
static inline struct complex_pair correction(const struct stage_mode *mode, struct complex_pair drop)
{
    struct complex_pair a = times(-mode->z_re, -mode->z_im, drop.re, drop.im);
    struct complex_pair b = times(a.re, a.im, a.re, a.im);
    struct complex_pair c = times(a.re, a.im, b.re, b.im);
    return (struct complex_pair){1.0 + a.re + b.re / 2 + c.re / 6, a.im + b.im / 2 + c.im / 6};
}

static inline void advance(const struct stage_mode *mode, double before, double now, double step, double *s, double *e)
{
    struct complex_pair free = times(mode->transition_re, mode->transition_im, s[0], s[1]);
    if (e) {
        struct complex_pair kept = times(mode->transition_re, mode->transition_im, e[0], e[1]);
        e[0] = kept.re + step * free.re + mode->old_slope_re * before + mode->new_slope_re * now;
        e[1] = kept.im + step * free.im + mode->old_slope_im * before + mode->new_slope_im * now;
    }
    s[0] = free.re + mode->old_re * before + mode->new_re * now;
    s[1] = free.im + mode->old_im * before + mode->new_im * now;
}

static inline void advance_moved(const struct stage_mode *mode, struct complex_pair drop, double before, double now,
                                 double step, double *s, double *e)
{
    struct complex_pair fix = correction(mode, drop);
    struct complex_pair phi = times(mode->transition_re, mode->transition_im, fix.re, fix.im);
    struct complex_pair move = times(-mode->pole_re, -mode->pole_im, drop.re, drop.im);
    struct complex_pair shaped = {mode->old_slope_re * before + mode->new_slope_re * now,
                                  mode->old_slope_im * before + mode->new_slope_im * now};
    struct complex_pair moved = times(move.re, move.im, shaped.re, shaped.im);
    struct complex_pair free = times(phi.re, phi.im, s[0], s[1]);
    if (e) {
        struct complex_pair kept = times(phi.re, phi.im, e[0], e[1]);
        e[0] = kept.re + step * free.re + shaped.re;
        e[1] = kept.im + step * free.im + shaped.im;
    }
    s[0] = free.re + mode->old_re * before + mode->new_re * now + moved.re;
    s[1] = free.im + mode->old_im * before + mode->new_im * now + moved.im;
}

void stage_modes(size_t n, const double *x, double step, size_t m, const struct stage_mode *modes, size_t axes,
                 const double *level, const double *drop, double *state, double *out, double *slope)
{
    for (size_t r = 0; n && r < m; r++) {
        settle(x[0], &modes[r], dropped(axes, level, drop + 2 * r * axes), state + 4 * r, state + 4 * r + 2);
    }
    for (size_t k = 0; k < n; k++) {
        for (size_t r = 0; r < m; r++) {
            double *s = state + 4 * r, *e = slope ? s + 2 : NULL;
            if (k) {
                if (axes) {
                    struct complex_pair by = dropped(axes, level + k * axes, drop + 2 * r * axes);
                    advance_moved(&modes[r], by, x[k - 1], x[k], step, s, e);
                } else {
                    advance(&modes[r], x[k - 1], x[k], step, s, e);
                }
            }
            out[2 * (k * m + r)] = modes[r].size * s[0];
            out[2 * (k * m + r) + 1] = modes[r].size * s[1];
            if (slope) {
                slope[2 * (k * m + r)] = modes[r].size_squared * e[0];
                slope[2 * (k * m + r) + 1] = modes[r].size_squared * e[1];
            }
        }
    }
}
