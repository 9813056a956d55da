#include "operator.h"

#include "fading.h"
#include "late_voltage.h"

#include <stdbool.h>

/* The conditional forms compile to packed min/max, which gcc does not do for fmin/fmax (their NaN rules differ). */
static inline void step(double v, size_t m, const double *restrict r, double scale, double *restrict p)
{
    for (size_t j = 0; j < m; j++) {
        double high = v + scale * r[j];
        double low = v - scale * r[j];
        double q = p[j] < high ? p[j] : high;
        p[j] = q > low ? q : low;
    }
}

/* What a play adds per unit of weight that stands at p. */
static inline double read_out(const struct stage_density *d, double p)
{
    double s = (p - d->middle) / d->half;
    double inside = s < -1.0 ? -1.0 : s > 1.0 ? 1.0 : s;
    double passed = inside * (1.0 + inside * (d->tilt / 2.0 - inside * d->taper / 3.0));
    double weight = 1.0 + inside * (d->tilt - inside * d->taper);
    return d->half * (passed + weight * (s - inside)) - d->at_zero;
}

static inline bool even(const struct stage_density *d)
{
    return d->tilt == 0.0 && d->taper == 0.0;
}

static inline double added(const struct stage_density *d, double p)
{
    return even(d) ? p : read_out(d, p);
}

void stage_delay(size_t n, const double *u, double before, double delay, double *v)
{
    size_t whole = delay < (double)n ? (size_t)delay : n;
    double part = delay < (double)n ? delay - (double)whole : 0.0;
    for (size_t k = 0; k < n; k++) {
        v[k] = late_voltage(u, before, k, whole, part);
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
        step(v[k], m, r, 1.0, p);
        if (wanted) {
            for (size_t j = 0; j < m; j++) {
                out[row * m + j] = p[j];
            }
            row++;
        }
    }
}

static void fill(const struct stage_basis *basis, double v, const double *p, const double *z, double x, double *out)
{
    for (size_t j = 0; j < basis->n_segments; j++) {
        double above = v > basis->low[j] ? v : basis->low[j];
        *out++ = (above < basis->high[j] ? above : basis->high[j]) - basis->segment_rest[j];
    }
    for (size_t j = 0; j < basis->n_plays; j++) {
        *out++ = added(&basis->density, p[j]) - basis->play_rest[j];
    }
    for (size_t j = 0; j < basis->n_fading; j++) {
        *out++ = v - basis->fading_r[j] * z[j] - basis->fading_rest[j];
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
                   double *z, double *out)
{
    size_t n = record->n;
    size_t whole = delay < (double)n ? (size_t)delay : n;
    double part = delay < (double)n ? delay - (double)whole : 0.0;
    size_t width = basis->n_segments + basis->n_plays + basis->n_fading + 2;
    double from = record->before;
    size_t turn = 0;
    size_t after = 0;
    step(record->before, basis->n_plays, basis->r, 1.0, p);
    for (size_t row = 0; row < record->n_rows;) {
        size_t wanted = record->rows[row];
        size_t turned = turn < record->n_turns ? record->turns[turn] + whole : wanted;
        size_t beyond = after < record->n_turns ? record->turns[after] + whole + 1 : wanted;
        size_t k = first_of(wanted, first_of(turned, beyond));
        double v = late_voltage(record->u, record->before, k, whole, part);
        step(v, basis->n_plays, basis->r, 1.0, p);
        for (size_t j = 0; j < basis->n_fading; j++) {
            z[j] = fading_step(from, v, basis->fading_r[j], z[j]);
        }
        from = v;
        turn += turn < record->n_turns && turned == k;
        after += after < record->n_turns && beyond == k;
        if (wanted == k) {
            fill(basis, v, p, z, record->x[row], out + row * width);
            row++;
        }
    }
}

/* Whether no play of a smaller threshold has lost touch with the next: then the smaller ones always move first. */
static bool nested(size_t m, const double *r, double scale, const double *p)
{
    for (size_t j = 0; j < m; j++) {
        double step_r = scale * (j ? r[j] - r[j - 1] : r[0]);
        double apart = j ? p[j] - p[j - 1] : 0.0, slack = 1e-9 * scale * r[j];
        if (!(step_r >= 0.0 && apart <= step_r + slack && -apart <= step_r + slack)) {
            return false;
        }
    }
    return true;
}

struct stack { /* nested plays: those before `moving` follow v, the others stand still */
    size_t m, moving;
    const double *r, *w;
    const struct stage_density *density;
    double scale, side;                 /* of the thresholds; -1 while v rises, 1 while it falls */
    double weight, reach, square, cube; /* sums of w, w r, w r^2 and w r^3 of those that move */
    double standing;                    /* what those that stand add */
    double *p;                          /* where those that stand are */
};

/* What the moving plays add. Within the span of the density that is a polynomial of v, whatever their number. */
static inline double of_moving(const struct stack *s, double v)
{
    const struct stage_density *d = s->density;
    if (even(d)) {
        return s->weight * v + s->side * s->reach;
    }
    double widest = s->moving ? s->scale * s->r[s->moving - 1] / d->half : 0.0;
    double a = (v - d->middle) / d->half;
    if (!(a + widest <= 1.0 && a - widest >= -1.0)) {
        double sum = 0.0;
        for (size_t j = 0; j < s->moving; j++) {
            sum += s->w[j] * read_out(d, v + s->side * (s->scale * s->r[j]));
        }
        return sum;
    }
    double first = s->side * s->reach / d->half, second = s->square / (d->half * d->half);
    double third = s->side * s->cube / (d->half * d->half * d->half);
    double straight = s->weight * a + first;
    double squares = a * (s->weight * a + 2.0 * first) + second;
    double cubes = a * (a * (s->weight * a + 3.0 * first) + 3.0 * second) + third;
    return d->half * (straight + d->tilt / 2.0 * squares - d->taper / 3.0 * cubes) - s->weight * d->at_zero;
}

static void stand_still(struct stack *s, double v)
{
    s->standing += of_moving(s, v);
    for (size_t j = 0; j < s->moving; j++) {
        s->p[j] = v + s->side * (s->scale * s->r[j]);
    }
    s->moving = 0;
    s->weight = s->reach = s->square = s->cube = 0.0;
}

static inline double follow(struct stack *s, double before, double v)
{
    double side = v > before ? -1.0 : v < before ? 1.0 : s->side;
    if (side != s->side) {
        stand_still(s, before);
        s->side = side;
    }
    for (; s->moving < s->m; s->moving++) {
        double r = s->scale * s->r[s->moving], p = s->p[s->moving], w = s->w[s->moving];
        if (!(side * (v + side * r - p) < 0.0)) {
            break;
        }
        s->weight += w;
        s->reach += w * r;
        s->square += w * r * r;
        s->cube += w * r * r * r;
        s->standing -= w * added(s->density, p);
    }
    return of_moving(s, v) + s->standing;
}

static double weighed(size_t m, const double *w, const struct stage_density *density, const double *p)
{
    double sum = 0.0;
    for (size_t j = 0; j < m; j++) {
        sum += w[j] * added(density, p[j]);
    }
    return sum;
}

static void weighed_plays(size_t n, const double *v, double scale, size_t m, const double *r, const double *w,
                          const struct stage_density *density, double *p, double *y)
{
    bool in_turn = false;
    struct stack s = {m, 0, r, w, density, scale, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, p};
    for (size_t k = 0; k < n; k++) {
        if (in_turn) {
            y[k] = follow(&s, v[k - 1], v[k]);
            continue;
        }
        step(v[k], m, r, scale, p);
        y[k] = weighed(m, w, density, p);
        if (nested(m, r, scale, p)) {
            in_turn = true;
            s.standing = y[k];
        }
    }
    if (in_turn) {
        stand_still(&s, v[n - 1]);
    }
}

void stage_weighed_plays(size_t n, const double *v, double scale, size_t m, const double *r, const double *w, double *p,
                         double *y)
{
    static const struct stage_density same = {0.0, 0.0, 0.0, 1.0, 0.0};
    weighed_plays(n, v, scale, m, r, w, &same, p, y);
}

void stage_response(const struct stage_operator *op, size_t n, const double *v, double *p, double *x)
{
    weighed_plays(n, v, 1.0, op->n_plays, op->play_r, op->play_w, &op->density, p, x);
    for (size_t k = 0; k < n; k++) {
        double sum = op->gain * v[k] + x[k];
        for (size_t j = 0; j < op->n_deadzones; j++) {
            double beyond = v[k] - op->deadzone_d[j];
            sum += op->deadzone_s[j] * (beyond > 0.0 ? beyond : 0.0);
        }
        x[k] = sum;
    }
}

int stage_operator_size(void)
{
    return (int)sizeof(struct stage_operator);
}

int stage_basis_size(void)
{
    return (int)sizeof(struct stage_basis);
}
