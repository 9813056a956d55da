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

static inline double late(const double *u, double before, size_t k, size_t whole, double part)
{
    double at = k >= whole ? u[k - whole] : before;
    double earlier = k > whole ? u[k - whole - 1] : before;
    return at + part * (earlier - at);
}

void stage_delay(size_t n, const double *u, double before, double delay, double *v)
{
    size_t whole = delay < (double)n ? (size_t)delay : n;
    double part = delay < (double)n ? delay - (double)whole : 0.0;
    for (size_t k = 0; k < n; k++) {
        v[k] = late(u, before, k, whole, part);
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

static void fill(const struct stage_basis *basis, double v, const double *p, double x, double *out)
{
    for (size_t j = 0; j < basis->n_segments; j++) {
        double above = v > basis->low[j] ? v : basis->low[j];
        *out++ = (above < basis->high[j] ? above : basis->high[j]) - basis->segment_rest[j];
    }
    for (size_t j = 0; j < basis->n_plays; j++) {
        *out++ = p[j] - basis->play_rest[j];
    }
    *out++ = 1.0;
    *out = x;
}

static inline size_t first_of(size_t a, size_t b)
{
    return a < b ? a : b;
}

/* A late voltage mixes two neighbouring rows, so it can turn round where the voltage did and one row after; what lies
 * between, the plays need not see. */
void stage_columns(const struct stage_record *record, double delay, const struct stage_basis *basis, double *p,
                   double *out)
{
    size_t n = record->n;
    size_t whole = delay < (double)n ? (size_t)delay : n;
    double part = delay < (double)n ? delay - (double)whole : 0.0;
    size_t width = basis->n_segments + basis->n_plays + 2;
    size_t turn = 0;
    size_t after = 0;
    step(record->before, basis->n_plays, basis->r, p);
    for (size_t row = 0; row < record->n_rows;) {
        size_t wanted = record->rows[row];
        size_t turned = turn < record->n_turns ? record->turns[turn] + whole : wanted;
        size_t beyond = after < record->n_turns ? record->turns[after] + whole + 1 : wanted;
        size_t k = first_of(wanted, first_of(turned, beyond));
        double v = late(record->u, record->before, k, whole, part);
        step(v, basis->n_plays, basis->r, p);
        turn += turn < record->n_turns && turned == k;
        after += after < record->n_turns && beyond == k;
        if (wanted == k) {
            fill(basis, v, p, record->x[row], out + row * width);
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
