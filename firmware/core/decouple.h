/* Cross-coupling, y_i = sum c_ij x_j with c_ii = 1, undone: the motions x of the axes that show as y.
 *
 * Which inverse is the right one depends on which axes move: one that stands still cannot help to cancel the others. So
 * there is one for every set of moving axes, made when a model is committed. Products are exact, the sum is the nearest
 * q16; the matrices are within 8 LSB of q28 of the exact inverse for couplings up to 1/4.
 */
#ifndef PHASELEAD_CORE_DECOUPLE_H
#define PHASELEAD_CORE_DECOUPLE_H

#include <stdbool.h>
#include <stdint.h>

#define DECOUPLE_AXES 3
#define DECOUPLE_ONE_Q28 (1 << 28)

struct decoupling {
    int32_t share_q28[1 << DECOUPLE_AXES][DECOUPLE_AXES][DECOUPLE_AXES]; /* [set of axes][to][from] */
};

/* Whether a row of couplings, those of `axis`, can be held: its own share 1, the others' below 2. */
bool decoupling_takes(const int32_t row_q28[DECOUPLE_AXES], unsigned axis);

/* False when a row is not taken, or some set of axes has no inverse (a determinant below 1/16, or a share of 4 and
 * more). Not for the tick. */
bool decoupling_make(const int32_t coupling_q28[DECOUPLE_AXES][DECOUPLE_AXES], struct decoupling *decoupling);

/* For the axes of `moving` (a mask): y in, x out, in place. The others stay as they are. NULL: nothing is coupled. */
void decouple(const struct decoupling *decoupling, uint32_t moving, int32_t values_q16[DECOUPLE_AXES], bool *saturated);

#endif
