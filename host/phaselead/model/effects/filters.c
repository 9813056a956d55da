#include "filters.h"

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

struct second_order { /* the first direct form: only one product and one sum wait for the answer before */
    const double *b, *a;
    double in[2], out[2];
};

static inline double answer(struct second_order *system, double in)
{
    const double *b = system->b, *a = system->a;
    double given = b[0] * in + b[1] * system->in[0] + b[2] * system->in[1];
    double out = given - a[2] * system->out[1] - a[1] * system->out[0];
    system->in[1] = system->in[0];
    system->in[0] = in;
    system->out[1] = system->out[0];
    system->out[0] = out;
    return out;
}

static void add_mode(size_t n, const double *x, const struct stage_share *mode, double *restrict y)
{
    struct second_order system = {mode->b, mode->a, {0.0, 0.0}, {0.0, 0.0}};
    for (size_t row = 0; row < n; row++) {
        double in = x[row] - x[0];
        y[row] += mode->share * (answer(&system, in) - in);
    }
}

/* One row of many columns, whose states are `first` and `second` (k) of the transposed second direct form: there the
 * columns fill vector instructions, and that form has the fewest states to fetch. */
static void add_mode_to_row(size_t k, const double *restrict x, const double *restrict rest,
                            const struct stage_share *mode, double *restrict first, double *restrict second,
                            double *restrict y)
{
    const double b0 = mode->b[0], b1 = mode->b[1], b2 = mode->b[2], a1 = mode->a[1], a2 = mode->a[2];
    for (size_t j = 0; j < k; j++) {
        double in = x[j] - rest[j];
        double out = first[j] + b0 * in;
        first[j] = second[j] + b1 * in - a1 * out;
        second[j] = b2 * in - a2 * out;
        y[j] += mode->share * (out - in);
    }
}

void stage_behind_modes(size_t n, size_t k, const double *x, size_t m, const struct stage_share *modes, double *states,
                        double *y)
{
    for (size_t i = 0; i < 2 * m * k; i++) {
        states[i] = 0.0;
    }
    for (size_t i = 0; i < n * k; i++) {
        y[i] = x[i];
    }
    for (size_t mode = 0; k == 1 && mode < m; mode++) {
        add_mode(n, x, modes + mode, y);
    }
    for (size_t row = 0; k > 1 && row < n; row++) {
        for (size_t mode = 0; mode < m; mode++) {
            double *first = states + 2 * mode * k;
            add_mode_to_row(k, x + row * k, x, modes + mode, first, first + k, y + row * k);
        }
    }
}

void stage_second_order(size_t n, const double *x, const double *b, const double *a, double *y)
{
    struct second_order system = {b, a, {0.0, 0.0}, {0.0, 0.0}};
    for (size_t k = 0; k < n; k++) {
        y[k] = answer(&system, x[k] - x[0]) + x[0];
    }
}

void stage_second_order_residual(size_t n, const double *x, const double *measured, const double *b, const double *a,
                                 double step, size_t n_rows, const size_t *rows, double *means)
{
    struct second_order system = {b, a, {0.0, 0.0}, {0.0, 0.0}};
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
