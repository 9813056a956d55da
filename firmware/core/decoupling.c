#include "core/decoupling.h"

#include "core/fixed.h"

#define N DECOUPLE_AXES
#define SHARE_MOST_Q28 (4 * (int64_t)DECOUPLE_ONE_Q28 - 1)
#define LEAST_DETERMINANT_Q28 (DECOUPLE_ONE_Q28 / 16)

/* Of the 2 x 2 matrix without row i and column j, with the sign of its place. Entries below 2: at most 8. */
static int64_t cofactor_q28(const int64_t m_q28[N][N], unsigned i, unsigned j)
{
    unsigned a = (i + 1) % N, b = (i + 2) % N, c = (j + 1) % N, d = (j + 2) % N; /* cyclic: the sign is in the order */
    return round_shift_i64(m_q28[a][c] * m_q28[b][d] - m_q28[a][d] * m_q28[b][c], 28);
}

static bool invert(const int64_t m_q28[N][N], int32_t inverse_q28[N][N])
{
    int64_t determinant_q56 = 0;
    for (unsigned j = 0; j < N; j++)
        determinant_q56 += m_q28[0][j] * cofactor_q28(m_q28, 0, j);
    int64_t determinant_q28 = round_shift_i64(determinant_q56, 28);
    if (determinant_q28 < LEAST_DETERMINANT_Q28)
        return false;
    bool beyond = false;
    for (unsigned i = 0; i < N; i++)
        for (unsigned j = 0; j < N; j++) {
            int64_t share_q28 = cofactor_q28(m_q28, j, i) * DECOUPLE_ONE_Q28 / determinant_q28;
            inverse_q28[i][j] = (int32_t)sat_between_i64(share_q28, -SHARE_MOST_Q28, SHARE_MOST_Q28, &beyond);
        }
    return !beyond;
}

bool decoupling_takes(const int32_t row_q28[N], unsigned axis)
{
    for (unsigned j = 0; j < N; j++) {
        uint64_t size_q28 = magnitude_i64(row_q28[j]);
        if (j == axis ? row_q28[j] != DECOUPLE_ONE_Q28 : size_q28 >= 2 * (uint64_t)DECOUPLE_ONE_Q28)
            return false;
    }
    return true;
}

/* The coupling among a set of axes; the others have none. */
static void coupling_among(const int32_t coupling_q28[N][N], unsigned set, int64_t m_q28[N][N])
{
    for (unsigned i = 0; i < N; i++)
        for (unsigned j = 0; j < N; j++) {
            bool both_move = (set >> i & set >> j & 1u) != 0;
            m_q28[i][j] = i == j || both_move ? coupling_q28[i][j] : 0;
        }
}

/* Makes the rows and columns of the other axes exactly those of the unit matrix, which rounding may have changed. */
static void leave_others(unsigned set, int32_t inverse_q28[N][N])
{
    for (unsigned i = 0; i < N; i++)
        for (unsigned j = 0; j < N; j++)
            if ((set >> i & set >> j & 1u) == 0)
                inverse_q28[i][j] = i == j ? DECOUPLE_ONE_Q28 : 0;
}

bool decoupling_make(const int32_t coupling_q28[N][N], struct decoupling *decoupling)
{
    for (unsigned i = 0; i < N; i++)
        if (!decoupling_takes(coupling_q28[i], i))
            return false;
    for (unsigned set = 0; set < 1u << N; set++) {
        int64_t m_q28[N][N];
        coupling_among(coupling_q28, set, m_q28);
        if (!invert((const int64_t (*)[N])m_q28, decoupling->share_q28[set]))
            return false;
        leave_others(set, decoupling->share_q28[set]);
    }
    return true;
}
