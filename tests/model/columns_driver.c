/* Calls the kernel with room and answers of exactly the size that it asks for, over records and bases of any size. */
#include "columns_behind_modes.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

static unsigned long long state = 88172645463325252ULL;

static double random_below(double most)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return most * (double)(state >> 11) / 9007199254740992.0;
}

static size_t size_below(size_t most)
{
    return (size_t)random_below((double)most);
}

static double *doubles(size_t n)
{
    return calloc(n ? n : 1, n ? sizeof(double) : 1);
}

/* Whether all columns are numbers. */
static bool try_one(void)
{
    size_t n = 1 + size_below(80), stride = 1 + size_below(n), n_rows = (n - 1) / stride + size_below(2);
    double *u = doubles(n);
    for (size_t k = 0; k < n; k++) {
        u[k] = k && size_below(3) == 0 ? u[k - 1] : (double)size_below(9) - 2.0;
    }
    size_t *rows = calloc(n_rows ? n_rows : 1, sizeof(size_t));
    for (size_t i = 0; i < n_rows; i++) {
        rows[i] = i * stride;
    }
    size_t n_segments = size_below(5), n_plays = size_below(6), n_modes = size_below(4);
    double *low = doubles(n_segments), *high = doubles(n_segments), *segment_rest = doubles(n_segments);
    for (size_t j = 0; j < n_segments; j++) {
        low[j] = j ? (double)j : -INFINITY;
        high[j] = j + 1 < n_segments ? (double)j + 1.0 : INFINITY;
    }
    double *r = doubles(n_plays), *play_rest = doubles(n_plays), *p = doubles(n_plays);
    for (size_t j = 0; j < n_plays; j++) {
        r[j] = (j ? r[j - 1] : 0.0) + random_below(1.0);
    }
    struct stage_share *modes = calloc(n_modes ? n_modes : 1, sizeof *modes);
    for (size_t i = 0; i < n_modes; i++) {
        double radius = random_below(0.999), turn = random_below(3.0), a1 = -2.0 * radius * cos(turn);
        double gain = 1.0 + a1 + radius * radius;
        modes[i] =
            (struct stage_share){random_below(2.0), {0.25 * gain, 0.5 * gain, 0.25 * gain}, {1.0, a1, radius * radius}};
    }
    double *x = doubles(n_rows), *out = doubles(n_rows * (n_segments + n_plays + 2));
    struct stage_record record = {n, u, u[0], 0, NULL, n_rows, rows, x};
    struct stage_basis basis = {n_segments, low,  high, segment_rest, n_plays, r, play_rest, {0.0, 0.0, 0.0, 1.0, 0.0},
                                0,          NULL, NULL};
    size_t size = stage_room_behind_modes(&record, &basis, n_modes);
    double *room = malloc(size ? size * sizeof(double) : 1);
    stage_columns_behind_modes(&record, random_below(2.0 * (double)n), &basis, n_modes, modes, p, room, out);
    bool numbers = true;
    for (size_t i = 0; i < n_rows * (n_segments + n_plays + 2); i++) {
        numbers = numbers && isfinite(out[i]);
    }
    void *all[] = {u, rows, low, high, segment_rest, r, play_rest, p, modes, x, out, room};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        free(all[i]);
    }
    return numbers;
}

int main(void)
{
    int good = 0;
    for (int i = 0; i < 20000; i++) {
        good += try_one();
    }
    printf("%d\n", good);
    return 0;
}
