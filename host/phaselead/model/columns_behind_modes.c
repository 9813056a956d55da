#include "columns_behind_modes.h"

#include "late_voltage.h"

#include <math.h>

static const double DIED_AWAY = 1e-18;

struct column { /* x - began = goes (v - voltage in row 0) + stands */
    double goes, stands;
    double began; /* x in row 0 */
};

struct state { /* of a mode, in the transposed second direct form: of all rows before this one */
    double first, second;
};

struct ring { /* what a mode still rings of: at the row that counted last, and what has begun since then, as it will be
                 at the row that counts next */
    struct state then, begun;
};

struct modes {
    size_t n;
    const struct stage_share *of;
    struct state *of_voltage;
    double *answers; /* of each mode to an impulse, `n_answers` rows: how a ring goes on */
    size_t n_answers;
};

struct columns {
    size_t n;
    struct column *of;
    struct ring *rings; /* n of each mode */
};

static size_t longest_gap(const struct stage_record *record)
{
    size_t before = 0, longest = 0;
    for (size_t i = 0; i < record->n_rows; i++) {
        size_t gap = record->rows[i] - before;
        longest = gap > longest ? gap : longest;
        before = record->rows[i];
    }
    return longest;
}

size_t stage_room_behind_modes(const struct stage_record *record, const struct stage_basis *basis, size_t n_modes)
{
    size_t columns = basis->n_segments + basis->n_plays;
    size_t of_a_mode = sizeof(struct state) + columns * sizeof(struct ring);
    return (columns * sizeof(struct column) + n_modes * of_a_mode) / sizeof(double) +
           n_modes * (longest_gap(record) + 1);
}

static void answer_to_impulse(const struct stage_share *mode, size_t n, double *answers)
{
    double at = 1.0, before = 0.0;
    for (size_t i = 0; i < n; i++) {
        answers[i] = at;
        double next = -mode->a[1] * at - mode->a[2] * before;
        before = at;
        at = fabs(next) + fabs(at) < DIED_AWAY ? 0.0 : next;
    }
}

/* The state after `rows` rows without input. */
static inline struct state after(const struct stage_share *mode, const double *answers, size_t rows, struct state s)
{
    if (rows == 0) {
        return s;
    }
    double now = answers[rows], before = answers[rows - 1], earlier = rows > 1 ? answers[rows - 2] : 0.0;
    double first = now * s.first + before * s.second;
    double second = -mode->a[2] * (before * s.first + earlier * s.second);
    return (struct state){first, second};
}

/* From a row on, `rows` before the next that counts, a column goes and stands otherwise. */
static void change(const struct modes *modes, const struct columns *columns, size_t j, size_t rows, double goes,
                   double stands)
{
    struct column *column = columns->of + j;
    double less = column->goes - goes, lower = column->stands - stands;
    for (size_t i = 0; i < modes->n; i++) {
        const struct stage_share *mode = modes->of + i;
        struct state v = modes->of_voltage[i], one = {1.0 - mode->b[0], mode->b[2] - mode->a[2]};
        struct state jump = {less * v.first + lower * one.first, less * v.second + lower * one.second};
        struct state then = after(mode, modes->answers + i * modes->n_answers, rows, jump);
        struct state *begun = &columns->rings[i * columns->n + j].begun;
        begun->first += then.first;
        begun->second += then.second;
    }
    column->goes = goes;
    column->stands = stands;
}

static double within(double v, double low, double high)
{
    return v < low ? low : v > high ? high : v;
}

static inline double goes_in(const struct stage_basis *basis, size_t j, double v)
{
    return v >= basis->low[j] && v < basis->high[j] ? 1.0 : 0.0;
}

static void begin(const struct stage_basis *basis, const double *p, double v, const struct modes *modes,
                  const struct columns *columns)
{
    for (size_t j = 0; j < basis->n_segments; j++) {
        columns->of[j] = (struct column){goes_in(basis, j, v), 0.0, within(v, basis->low[j], basis->high[j])};
    }
    for (size_t j = 0; j < basis->n_plays; j++) {
        columns->of[basis->n_segments + j] = (struct column){0.0, 0.0, p[j]};
    }
    for (size_t i = 0; i < modes->n; i++) {
        modes->of_voltage[i] = (struct state){0.0, 0.0};
        answer_to_impulse(modes->of + i, modes->n_answers, modes->answers + i * modes->n_answers);
        for (size_t j = 0; j < columns->n; j++) {
            columns->rings[i * columns->n + j] = (struct ring){{0.0, 0.0}, {0.0, 0.0}};
        }
    }
}

static void step_of_voltage(const struct modes *modes, double from_rest)
{
    for (size_t i = 0; i < modes->n; i++) {
        const struct stage_share *mode = modes->of + i;
        struct state *s = modes->of_voltage + i;
        double out = s->first + mode->b[0] * from_rest;
        s->first = s->second + mode->b[1] * from_rest - mode->a[1] * out;
        s->second = mode->b[2] * from_rest - mode->a[2] * out;
    }
}

/* The columns of a row that counts, `rows` after the one before, at a voltage `from_rest` above that of row 0. */
static void write_row(const struct stage_basis *basis, const struct modes *modes, const struct columns *columns,
                      size_t rows, double from_rest, double x, double *out)
{
    for (size_t j = 0; j < columns->n; j++) {
        const struct column *column = columns->of + j;
        size_t play = j - basis->n_segments;
        double rest = j < basis->n_segments ? basis->segment_rest[j] : basis->play_rest[play];
        out[j] = column->began + column->goes * from_rest + column->stands - rest;
    }
    for (size_t i = 0; i < modes->n; i++) {
        const struct stage_share *mode = modes->of + i;
        double beyond = modes->of_voltage[i].first + mode->b[0] * from_rest - from_rest;
        for (size_t j = 0; j < columns->n; j++) {
            struct ring *ring = columns->rings + i * columns->n + j;
            ring->then = after(mode, modes->answers + i * modes->n_answers, rows, ring->then);
            ring->then.first += ring->begun.first;
            ring->then.second += ring->begun.second;
            ring->begun = (struct state){0.0, 0.0};
            out[j] += mode->share * (columns->of[j].goes * beyond + ring->then.first);
        }
    }
    out[columns->n] = 1.0;
    out[columns->n + 1] = x;
}

struct walk {
    const struct stage_basis *basis;
    const struct modes *modes;
    const struct columns *columns;
    double v0;       /* the voltage in row 0 */
    size_t segment;  /* that the voltage is in */
    size_t moving;   /* plays, of the smallest thresholds */
    double side, *p; /* of those that move: -1 while the voltage rises, 1 while it falls; where the others stand */
};

static void follow_segments(struct walk *walk, double v, size_t rows)
{
    const struct stage_basis *basis = walk->basis;
    if (!basis->n_segments || goes_in(basis, walk->segment, v) != 0.0) {
        return;
    }
    for (size_t j = 0; j < basis->n_segments; j++) {
        const struct column *column = walk->columns->of + j;
        double goes = goes_in(basis, j, v);
        double stands = (goes != 0.0 ? walk->v0 : within(v, basis->low[j], basis->high[j])) - column->began;
        if (goes != column->goes || stands != column->stands) {
            change(walk->modes, walk->columns, j, rows, goes, stands);
        }
        walk->segment = goes != 0.0 ? j : walk->segment;
    }
}

static void follow_plays(struct walk *walk, double before, double v, size_t rows)
{
    const double *r = walk->basis->r;
    const size_t first = walk->basis->n_segments;
    if ((v - before) * walk->side > 0.0) {
        for (size_t j = 0; j < walk->moving; j++) {
            walk->p[j] = before + walk->side * r[j];
            change(walk->modes, walk->columns, first + j, rows, 0.0, walk->p[j] - walk->columns->of[first + j].began);
        }
        walk->moving = 0;
        walk->side = -walk->side;
    }
    for (; walk->moving < walk->basis->n_plays; walk->moving++) {
        size_t j = walk->moving;
        double stands = walk->side * r[j] - walk->columns->of[first + j].began;
        if (!(walk->side * (v + walk->side * r[j] - walk->p[j]) < 0.0)) {
            break;
        }
        change(walk->modes, walk->columns, first + j, rows, 1.0, walk->v0 + stands);
    }
}

void stage_columns_behind_modes(const struct stage_record *record, double delay, const struct stage_basis *basis,
                                size_t n_modes, const struct stage_share *shares, double *p, double *room, double *out)
{
    size_t whole = delay < (double)record->n ? (size_t)delay : record->n;
    double part = delay < (double)record->n ? delay - (double)whole : 0.0;
    struct columns columns = {basis->n_segments + basis->n_plays, (struct column *)room, NULL};
    columns.rings = (struct ring *)(columns.of + columns.n);
    struct modes modes = {n_modes, shares, (struct state *)(columns.rings + n_modes * columns.n), NULL, 0};
    modes.answers = (double *)(modes.of_voltage + n_modes);
    modes.n_answers = longest_gap(record) + 1;

    double v0 = late_voltage(record->u, record->before, 0, whole, part), v = v0;
    for (size_t j = 0; j < basis->n_plays; j++) {
        double r = basis->r[j];
        p[j] = within(within(p[j], record->before - r, record->before + r), v0 - r, v0 + r);
    }
    begin(basis, p, v0, &modes, &columns);
    struct walk walk = {basis, &modes, &columns, v0, 0, 0, -1.0, p};
    size_t counted = 0;
    for (size_t row = 0, k = 0; row < record->n_rows; k++) {
        double before = v;
        size_t rows = record->rows[row] - k;
        v = late_voltage(record->u, record->before, k, whole, part);
        follow_segments(&walk, v, rows);
        follow_plays(&walk, before, v, rows);
        if (rows == 0) {
            write_row(basis, &modes, &columns, k - counted, v - v0, record->x[row], out + row * (columns.n + 2));
            counted = k;
            row++;
        }
        step_of_voltage(&modes, v - v0);
    }
}
