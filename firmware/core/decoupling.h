/* The inverses of the cross-coupling that decouple.h uses, made when a model is committed. Not for the tick. */
#ifndef PHASELEAD_CORE_DECOUPLING_H
#define PHASELEAD_CORE_DECOUPLING_H

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
 * more). */
bool decoupling_make(const int32_t coupling_q28[DECOUPLE_AXES][DECOUPLE_AXES], struct decoupling *decoupling);

#endif
