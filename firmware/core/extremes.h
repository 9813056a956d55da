/* How far a voltage has been since a stage rested at 0 V: of all that plays remember of it, what wiped out the rest. */
#ifndef PHASELEAD_CORE_EXTREMES_H
#define PHASELEAD_CORE_EXTREMES_H

#include <stdint.h>

struct extremes { /* all zero: at rest at 0 V */
    int32_t low_q24, high_q24;
    uint32_t rose_last; /* 1: the highest came after the lowest */
};

/* The voltage has gone to v. */
static inline void extremes_follow(struct extremes *extremes, int32_t v_q24)
{
    if (v_q24 > extremes->high_q24) {
        extremes->high_q24 = v_q24;
        extremes->rose_last = 1;
    } else if (v_q24 < extremes->low_q24) {
        extremes->low_q24 = v_q24;
        extremes->rose_last = 0;
    }
}

#endif
