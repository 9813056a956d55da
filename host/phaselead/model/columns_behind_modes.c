#include "columns_behind_modes.h"

#include "late_voltage.h"

#include <math.h>
#include <stdbool.h>

static const double DIED_AWAY = 1e-18; /* V */

struct column { /* x = goes (v - v in row 0) + level */
    double goes, level;
};

struct state { /* of a mode, in the transposed second direct form: of all rows before this one */
    double first, second;
};

struct ring { /* of a mode: at the row that counted last, and what is new since then, as it will be at the next one */
    struct state last, new;
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

/* What has died away is 0, for a processor is slow with the smallest numbers. */
static inline struct state alive(double first, double second)
{
    bool died = fabs(first) + fabs(second) < DIED_AWAY;
    return died ? (struct state){0.0, 0.0} : (struct state){first, second};
}

static void answer_to_impulse(const struct stage_share *mode, size_t n, double *answers)
{
    struct state s = {1.0, 0.0};
    for (size_t i = 0; i < n; i++) {
        answers[i] = s.first;
        s = alive(s.second - mode->a[1] * s.first, -mode->a[2] * s.first);
    }
}

/* The state after `rows` rows without input. */
static inline struct state later(const struct stage_share *mode, const double *answers, size_t rows, struct state s)
{
    if (rows == 0) {
        return s;
    }
    double now = answers[rows], before = answers[rows - 1], earlier = rows > 1 ? answers[rows - 2] : 0.0;
    return (struct state){now * s.first + before * s.second, -mode->a[2] * (before * s.first + earlier * s.second)};
}

/* From this row on, `rows_left` before the next that counts, a column goes and stands otherwise. */
static void change(const struct modes *modes, const struct columns *columns, size_t j, size_t rows_left,
                   struct column from_here)
{
    struct column *column = columns->of + j;
    double less = column->goes - from_here.goes, lower = column->level - from_here.level;
    for (size_t i = 0; i < modes->n; i++) {
        const struct stage_share *mode = modes->of + i;
        struct state v = modes->of_voltage[i], one = {1.0 - mode->b[0], mode->b[2] - mode->a[2]};
        struct state jump = {less * v.first + lower * one.first, less * v.second + lower * one.second};
        struct state then = later(mode, modes->answers + i * modes->n_answers, rows_left, jump);
        struct state *new = &columns->rings[i * columns->n + j].new;
        new->first += then.first;
        new->second += then.second;
    }
    *column = from_here;
}

static void step_of_voltage(const struct modes *modes, double from_rest)
{
    for (size_t i = 0; i < modes->n; i++) {
        const struct stage_share *mode = modes->of + i;
        struct state s = modes->of_voltage[i];
        double out = s.first + mode->b[0] * from_rest;
        modes->of_voltage[i] =
            alive(s.second + mode->b[1] * from_rest - mode->a[1] * out, mode->b[2] * from_rest - mode->a[2] * out);
    }
}

/* The columns of a row that counts, `rows_since` after the one before, at a voltage `from_rest` above that of row 0. */
static void write_row(const struct stage_basis *basis, const struct modes *modes, const struct columns *columns,
                      size_t rows_since, double from_rest, double x, double *out)
{
    for (size_t j = 0; j < columns->n; j++) {
        out[j] = columns->of[j].goes * from_rest + columns->of[j].level;
    }
    for (size_t j = 0; j < basis->n_segments; j++) {
        out[j] -= basis->segment_rest[j];
    }
    for (size_t j = 0; j < basis->n_plays; j++) {
        out[basis->n_segments + j] -= basis->play_rest[j];
    }
    for (size_t i = 0; i < modes->n; i++) {
        const struct stage_share *mode = modes->of + i;
        double beyond = modes->of_voltage[i].first + mode->b[0] * from_rest - from_rest;
        for (size_t j = 0; j < columns->n; j++) {
            struct ring *ring = columns->rings + i * columns->n + j;
            struct state s = later(mode, modes->answers + i * modes->n_answers, rows_since, ring->last);
            ring->last = alive(s.first + ring->new.first, s.second + ring->new.second);
            ring->new = (struct state){0.0, 0.0};
            out[j] += mode->share * (columns->of[j].goes * beyond + ring->last.first);
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
    size_t moving;   /* plays, those of the smallest thresholds */
    double side, *p; /* of those that move: -1 while the voltage rises, 1 while it falls; where the others stand */
};

static inline bool in_segment(const struct stage_basis *basis, size_t j, double v)
{
    return v >= basis->low[j] && v < basis->high[j];
}

static double within(double v, double low, double high)
{
    return v < low ? low : v > high ? high : v;
}

static struct column segment_at(const struct walk *walk, size_t j, double v)
{
    const struct stage_basis *basis = walk->basis;
    bool inside = in_segment(basis, j, v);
    return inside ? (struct column){1.0, walk->v0} : (struct column){0.0, within(v, basis->low[j], basis->high[j])};
}

static void begin(const struct walk *walk)
{
    const struct stage_basis *basis = walk->basis;
    const struct modes *modes = walk->modes;
    const struct columns *columns = walk->columns;
    for (size_t j = 0; j < basis->n_segments; j++) {
        columns->of[j] = segment_at(walk, j, walk->v0);
    }
    for (size_t j = 0; j < basis->n_plays; j++) {
        columns->of[basis->n_segments + j] = (struct column){0.0, walk->p[j]};
    }
    for (size_t i = 0; i < modes->n; i++) {
        modes->of_voltage[i] = (struct state){0.0, 0.0};
        answer_to_impulse(modes->of + i, modes->n_answers, modes->answers + i * modes->n_answers);
        for (size_t j = 0; j < columns->n; j++) {
            columns->rings[i * columns->n + j] = (struct ring){{0.0, 0.0}, {0.0, 0.0}};
        }
    }
}

static void follow_segments(struct walk *walk, double v, size_t rows_left)
{
    const struct stage_basis *basis = walk->basis;
    if (!basis->n_segments || in_segment(basis, walk->segment, v)) {
        return;
    }
    for (size_t j = 0; j < basis->n_segments; j++) {
        struct column at = segment_at(walk, j, v), before = walk->columns->of[j];
        if (at.goes != before.goes || at.level != before.level) {
            change(walk->modes, walk->columns, j, rows_left, at);
        }
        walk->segment = in_segment(basis, j, v) ? j : walk->segment;
    }
}

static void follow_plays(struct walk *walk, double before, double v, size_t rows_left)
{
    const double *r = walk->basis->r;
    const size_t first = walk->basis->n_segments;
    if ((v - before) * walk->side > 0.0) {
        for (size_t j = 0; j < walk->moving; j++) {
            walk->p[j] = before + walk->side * r[j];
            change(walk->modes, walk->columns, first + j, rows_left, (struct column){0.0, walk->p[j]});
        }
        walk->moving = 0;
        walk->side = -walk->side;
    }
    for (; walk->moving < walk->basis->n_plays; walk->moving++) {
        size_t j = walk->moving;
        double behind = walk->side * r[j];
        if (!(walk->side * (v + behind - walk->p[j]) < 0.0)) {
            break;
        }
        change(walk->modes, walk->columns, first + j, rows_left, (struct column){1.0, walk->v0 + behind});
    }
}

void stage_columns_behind_modes(const struct stage_record *record, double delay, const struct stage_basis *basis,
                                size_t n_modes, const struct stage_share *modes, double *p, double *room, double *out)
{
    size_t whole = delay < (double)record->n ? (size_t)delay : record->n;
    double part = delay < (double)record->n ? delay - (double)whole : 0.0;
    struct columns columns = {basis->n_segments + basis->n_plays, (struct column *)room, NULL};
    columns.rings = (struct ring *)(columns.of + columns.n);
    struct modes carrying = {n_modes, modes, (struct state *)(columns.rings + n_modes * columns.n), NULL, 0};
    carrying.answers = (double *)(carrying.of_voltage + n_modes);
    carrying.n_answers = longest_gap(record) + 1;

    double v0 = late_voltage(record->u, record->before, 0, whole, part), v = v0;
    for (size_t j = 0; j < basis->n_plays; j++) {
        double r = basis->r[j];
        p[j] = within(within(p[j], record->before - r, record->before + r), v0 - r, v0 + r);
    }
    struct walk walk = {basis, &carrying, &columns, v0, 0, 0, -1.0, p};
    begin(&walk);
    size_t last = 0;
    for (size_t row = 0, k = 0; row < record->n_rows; k++) {
        double before = v;
        size_t rows_left = record->rows[row] - k;
        v = late_voltage(record->u, record->before, k, whole, part);
        follow_segments(&walk, v, rows_left);
        follow_plays(&walk, before, v, rows_left);
        if (rows_left == 0) {
            write_row(basis, &carrying, &columns, k - last, v - v0, record->x[row], out + row * (columns.n + 2));
            last = k;
            row++;
        }
        step_of_voltage(&carrying, v - v0);
    }
}
