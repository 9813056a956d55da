#include "whiten.h"

#include <math.h>

enum { BLOCK = 2048 /* values that stay in the cache from step to step */ };

/* `count` neighbouring values, k a row; the taps run back over rows before, of which there are enough. Four taps a
 * pass: a sum over all of them within one would not become vector instructions. */
static void filter(size_t n_taps, const double *taps, size_t k, size_t count, const double *in, double *restrict out)
{
    for (size_t i = 0; i < count; i++) {
        out[i] = taps[0] * in[i];
    }
    size_t tap = 1;
    for (; tap + 4 <= n_taps; tap += 4) {
        const double *a = in - tap * k, *b = a - k, *c = b - k, *d = c - k;
        const double by_a = taps[tap], by_b = taps[tap + 1], by_c = taps[tap + 2], by_d = taps[tap + 3];
        for (size_t i = 0; i < count; i++) {
            out[i] += by_a * a[i] + by_b * b[i] + (by_c * c[i] + by_d * d[i]);
        }
    }
    for (; tap < n_taps; tap++) {
        const double *a = in - tap * k, by_a = taps[tap];
        for (size_t i = 0; i < count; i++) {
            out[i] += by_a * a[i];
        }
    }
}

static void sense(const struct gap_whitener *w, size_t from, size_t to, size_t k, const double *values, double *sensed)
{
    size_t first = w->n_sensor - 1;
    for (; from < to && from < first; from++) {
        for (size_t j = 0; j < k; j++) {
            sensed[from * k + j] = 0.0;
        }
    }
    filter(w->n_sensor, w->sensor, k, (to - from) * k, values + from * k, sensed + from * k);
}

/* As along_path, for one column, whose last step need not be fetched again. */
static void along_path_of_one(const struct gap_whitener *w, size_t from, size_t to, const double *sensed, double *steps)
{
    double solved = from ? steps[from - 1] : 0.0;
    for (size_t row = from; row < to; row++) {
        double scale = 1.0 / w->diag[row];
        double moved = row ? sensed[row] - w->phi[row] * sensed[row - 1] : sensed[row];
        double below = row ? w->below[row - 1] * scale : 0.0;
        solved = moved * scale - below * solved;
        steps[row] = solved;
    }
}

static void along_path(const struct gap_whitener *w, size_t from, size_t to, size_t k, const double *sensed,
                       double *steps)
{
    for (size_t row = from; row < to; row++) {
        const double *now = sensed + row * k;
        double *out = steps + row * k, scale = 1.0 / w->diag[row];
        double phi = row ? w->phi[row] : 0.0, below = row ? w->below[row - 1] * scale : 0.0;
        const double *before = row ? now - k : now, *solved = row ? out - k : now;
        for (size_t j = 0; j < k; j++) {
            out[j] = (now[j] - phi * before[j]) * scale - below * solved[j];
        }
    }
}

/* Rows alike in a stretch: all in motion and with enough of a past, or not. */
static void settle(const struct gap_whitener *w, size_t from, size_t to, size_t k, const double *steps, double *white)
{
    for (size_t row = from; row < to;) {
        size_t moving = w->moving[row], end = row + 1, taps = moving ? w->n_rest : 0;
        if (row + 1 < taps) {
            taps = row + 1;
        } else {
            while (end < to && w->moving[end] == moving) {
                end++;
            }
        }
        if (taps) {
            filter(taps, w->rest, k, (end - row) * k, steps + row * k, white + row * k);
        } else {
            for (size_t i = row * k; i < end * k; i++) {
                white[i] = steps[i];
            }
        }
        row = end;
    }
}

/* In blocks that stay in the cache; the last step is one block late, since the step before it looks one row back. */
void gap_whiten(const struct gap_whitener *w, size_t n, size_t k, const double *values, double *steps, double *white)
{
    size_t rows = k < BLOCK ? BLOCK / (k ? k : 1) : 1, late = 0;
    for (size_t row = 0; row < n; row += rows) {
        size_t end = n - row < rows ? n : row + rows;
        sense(w, row, end, k, values, white);
        if (k == 1) {
            along_path_of_one(w, row, end, white, steps);
        } else {
            along_path(w, row, end, k, white, steps);
        }
        settle(w, late, row, k, steps, white);
        late = row;
    }
    settle(w, late, n, k, steps, white);
}

void gap_differences_factor(size_t n, const double *phi, const double *grown, double first, double *diag, double *below)
{
    double pivot = 1.0 + first;
    for (size_t row = 0; row < n; row++) {
        if (row) {
            pivot = 1.0 + phi[row] * phi[row] + grown[row] - phi[row] * phi[row] / pivot;
        }
        diag[row] = pivot;
    }
    for (size_t row = 0; row < n; row++) {
        diag[row] = sqrt(diag[row]);
        below[row] = row + 1 < n ? -phi[row + 1] / diag[row] : 0.0;
    }
}
