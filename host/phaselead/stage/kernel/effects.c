#include "effects.h"

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

void stage_second_order(size_t n, const double *x, const double *b, const double *a, double *y)
{
    double first = 0.0;
    double second = 0.0;
    for (size_t k = 0; k < n; k++) {
        double in = x[k] - x[0];
        double out = first + b[0] * in;
        first = second + b[1] * in - a[1] * out;
        second = b[2] * in - a[2] * out;
        y[k] = out + x[0];
    }
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
                        double *p, double *y)
{
    for (size_t k = 0; k < n; k++) {
        double sum = 0.0;
        for (size_t j = 0; j < m; j++) {
            double reach = scale[k] * r[j];
            double high = v[k] + reach;
            double low = v[k] - reach;
            double q = p[j] < high ? p[j] : high;
            p[j] = q > low ? q : low;
            sum += w[j] * p[j];
        }
        y[k] = sum;
    }
}

static double row(const double *x, size_t n, size_t k, size_t back, size_t ahead)
{
    if (k + ahead < back) {
        return x[0];
    }
    size_t at = k + ahead - back;
    return x[at < n ? at : n - 1];
}

void stage_smooth_delay(size_t n, const double *x, double delay, double *y)
{
    size_t whole = delay < (double)n ? (size_t)delay : n;
    double part = delay < (double)n ? delay - (double)whole : 0.0;
    for (size_t k = 0; k < n; k++) {
        double near = row(x, n, k, whole, 0), far = row(x, n, k, whole + 1, 0);
        double near_bend = row(x, n, k, whole, 1) - 2 * near + far;
        double far_bend = near - 2 * far + row(x, n, k, whole + 2, 0);
        y[k] = near + part * (far - near);
        if (near_bend * far_bend > 0) {
            if (near_bend / far_bend > 2) {
                near_bend = 2 * far_bend;
            } else if (far_bend / near_bend > 2) {
                far_bend = 2 * near_bend;
            }
            y[k] -= part * (1 - part) / 6 * ((2 - part) * near_bend + (1 + part) * far_bend);
        }
    }
}
