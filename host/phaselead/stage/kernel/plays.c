#include "plays.h"

#include <stdbool.h>

/* The conditional forms compile to packed min/max, which gcc does not do for fmin/fmax (their NaN rules differ). */
static inline void step(double v, size_t m, const double *restrict r, double *restrict p)
{
    for (size_t j = 0; j < m; j++) {
        double high = v + r[j];
        double low = v - r[j];
        double q = p[j] < high ? p[j] : high;
        p[j] = q > low ? q : low;
    }
}

void stage_delay(size_t n, const double *u, double before, double delay, double *v)
{
    size_t whole = delay < (double)n ? (size_t)delay : n;
    double part = delay < (double)n ? delay - (double)whole : 0.0;
    for (size_t k = 0; k < n; k++) {
        double late = k >= whole ? u[k - whole] : before;
        double later = k > whole ? u[k - whole - 1] : before;
        v[k] = late + part * (later - late);
    }
}

/* Where a voltage only goes on in its direction, the plays are where its end alone would put them. */
static inline bool goes_on(double from, double at, double to)
{
    return (from <= at && at <= to) || (from >= at && at >= to);
}

void stage_plays(size_t n, const double *v, size_t m, const double *r, double *p, size_t n_rows, const size_t *rows,
                 double *out)
{
    size_t row = 0;
    double from = 0.0;
    for (size_t k = 0; k < n; k++) {
        bool wanted = row < n_rows && rows[row] == k;
        if (!wanted && k > 0 && k + 1 < n && goes_on(from, v[k], v[k + 1])) {
            continue;
        }
        from = v[k];
        step(v[k], m, r, p);
        if (wanted) {
            for (size_t j = 0; j < m; j++) {
                out[row * m + j] = p[j];
            }
            row++;
        }
    }
}

void stage_response(const struct stage_operator *op, size_t n, const double *v, double *p, double *x)
{
    for (size_t k = 0; k < n; k++) {
        step(v[k], op->n_plays, op->play_r, p);
        double sum = op->gain * v[k];
        for (size_t j = 0; j < op->n_plays; j++) {
            sum += op->play_w[j] * p[j];
        }
        for (size_t j = 0; j < op->n_deadzones; j++) {
            double beyond = v[k] - op->deadzone_d[j];
            sum += beyond > 0.0 ? op->deadzone_s[j] * beyond : 0.0;
        }
        x[k] = sum;
    }
}
