/* Cross-coupling, y_i = sum c_ij x_j with c_ii = 1, undone: the motions x of the axes that the sensors see as y.
 *
 * Which inverse is the right one depends on which axes move: one that stands still cannot cancel what the others cause.
 * So there is one for every set of moving axes, made when a model is committed. Products are exact, the sum is the
 * nearest q16; the matrices are within 8 LSB of q28 of the exact inverse for couplings up to 1/4.
 */
#ifndef PHASELEAD_CORE_DECOUPLE_H
#define PHASELEAD_CORE_DECOUPLE_H

#include "core/decoupling.h"

/* For the axes of `moving` (a mask): y in, x out, in place. The others stay as they are. NULL: nothing is coupled. */
void decouple(const struct decoupling *decoupling, uint32_t moving, int32_t values_q16[DECOUPLE_AXES], bool *saturated);

/* The other way round: what the sensors see of the motions x of these axes together. The others' count for nothing. */
void couple(const int32_t coupling_q28[DECOUPLE_AXES][DECOUPLE_AXES], uint32_t moving,
            int32_t values_q16[DECOUPLE_AXES]);

#endif
