/* How far a voltage has been since a stage rested at 0 V, and where it was last: what plays remember of it, but for
 * turns between the two. */
#ifndef PHASELEAD_CORE_EXTREMES_H
#define PHASELEAD_CORE_EXTREMES_H

#include <stdint.h>

/* Of the distance between the two: a voltage that comes as near to one as that has been there again. Chosen, so that a
 * turn that noise or the phase of a sample misses counts. */
#define EXTREMES_NEAR_SHARE 256

struct extremes { /* all zero: at rest at 0 V */
    int32_t low_q24, high_q24;
    uint32_t rose_last; /* 1: it was at the highest after it was at the lowest */
};

/* The voltage has gone to v. */
static inline void extremes_follow(struct extremes *extremes, int32_t v_q24)
{
    const int64_t near_q24 = ((int64_t)extremes->high_q24 - extremes->low_q24) / EXTREMES_NEAR_SHARE;
    if (v_q24 >= extremes->high_q24 - near_q24) {
        extremes->high_q24 = v_q24 > extremes->high_q24 ? v_q24 : extremes->high_q24;
        extremes->rose_last = 1;
    } else if (v_q24 <= extremes->low_q24 + near_q24) {
        extremes->low_q24 = v_q24 < extremes->low_q24 ? v_q24 : extremes->low_q24;
        extremes->rose_last = 0;
    }
}

#endif
