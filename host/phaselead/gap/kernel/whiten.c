#include "whiten.h"

static void filtered(size_t n_taps, const double *taps, size_t k, const double *last, double *out)
{
    for (size_t j = 0; j < k; j++) {
        out[j] = taps[0] * last[j];
    }
    for (size_t tap = 1; tap < n_taps; tap++) {
        const double *row = last - tap * k;
        for (size_t j = 0; j < k; j++) {
            out[j] += taps[tap] * row[j];
        }
    }
}

static void along_path(const struct gap_whitener *w, size_t n, size_t k, const double *sensed, double *steps)
{
    for (size_t row = 0; row < n; row++) {
        const double *now = sensed + row * k;
        double *out = steps + row * k, scale = 1.0 / w->diag[row];
        double phi = row ? w->phi[row] : 0.0, below = row ? w->below[row - 1] : 0.0;
        const double *before = row ? now - k : now, *solved = row ? out - k : now;
        for (size_t j = 0; j < k; j++) {
            out[j] = (now[j] - phi * before[j] - below * solved[j]) * scale;
        }
    }
}

void gap_whiten(const struct gap_whitener *w, size_t n, size_t k, const double *values, double *steps, double *white)
{
    for (size_t row = 0; row < n; row++) {
        if (row + 1 < w->n_sensor) {
            for (size_t j = 0; j < k; j++) {
                white[row * k + j] = 0.0;
            }
        } else {
            filtered(w->n_sensor, w->sensor, k, values + row * k, white + row * k);
        }
    }
    along_path(w, n, k, white, steps);
    for (size_t row = 0; row < n; row++) {
        size_t taps = w->moving[row] ? w->n_rest : 0;
        taps = taps > row + 1 ? row + 1 : taps;
        if (taps) {
            filtered(taps, w->rest, k, steps + row * k, white + row * k);
        } else {
            for (size_t j = 0; j < k; j++) {
                white[row * k + j] = steps[row * k + j];
            }
        }
    }
}
