#include "effects.h"

#include <math.h>

void stage_lags(size_t n, const double *x, size_t m, const struct stage_lag *lags, double *s, double *y)
{
    double before = n ? x[0] : 0.0;
    for (size_t j = 0; j < m; j++) {
        s[j] = before;
    }
    for (size_t k = 0; k < n; k++) {
        double sum = 0.0;
        for (size_t j = 0; j < m; j++) {
            s[j] += lags[j].old * (before - s[j]) + lags[j].new * (x[k] - s[j]);
            sum += lags[j].gain * s[j];
        }
        y[k] = sum;
        before = x[k];
    }
}

struct second_order { /* the transposed second direct form */
    const double *b, *a;
    double first, second;
};

static inline double answer(struct second_order *system, double in)
{
    double out = system->first + system->b[0] * in;
    system->first = system->second + system->b[1] * in - system->a[1] * out;
    system->second = system->b[2] * in - system->a[2] * out;
    return out;
}

void stage_second_order(size_t n, const double *x, const double *b, const double *a, double *y)
{
    struct second_order system = {b, a, 0.0, 0.0};
    for (size_t k = 0; k < n; k++) {
        y[k] = answer(&system, x[k] - x[0]) + x[0];
    }
}

void stage_second_order_left(size_t n, const double *x, const double *measured, const double *b, const double *a,
                             double step, size_t n_rows, const size_t *rows, double *means)
{
    struct second_order system = {b, a, 0.0, 0.0};
    double e_sum = 0.0, d_sum = 0.0, ee = 0.0, ed = 0.0, dd = 0.0;
    double before = 0.0;
    double at = n ? answer(&system, 0.0) : 0.0;
    size_t row = 0;
    for (size_t k = 0; k < n && row < n_rows; k++) {
        double after = k + 1 < n ? answer(&system, x[k + 1] - x[0]) : at;
        if (rows[row] == k) {
            double rows_between = k > 0 && k + 1 < n ? 2.0 : 1.0;
            double d = (after - (k > 0 ? before : at)) / (rows_between * step);
            double e = measured[k] - x[0] - at;
            e_sum += e;
            d_sum += d;
            ee += e * e;
            ed += e * d;
            dd += d * d;
            row++;
        }
        before = at;
        at = after;
    }
    double count = (double)n_rows;
    means[0] = ee / count - e_sum / count * (e_sum / count);
    means[1] = ed / count - e_sum / count * (d_sum / count);
    means[2] = dd / count - d_sum / count * (d_sum / count);
}

void stage_slew(size_t n, const double *x, double rise, double *y)
{
    double at = n ? x[0] : 0.0;
    for (size_t k = 0; k < n; k++) {
        double far = x[k] - at;
        at = far > rise ? at + rise : far < -rise ? at - rise : x[k];
        y[k] = at;
    }
}

void stage_scaled_plays(size_t n, const double *v, const double *scale, size_t m, const double *r, const double *w,
                        double held, double *p, double *y)
{
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
