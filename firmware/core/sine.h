/* Sine and cosine of a phase, from a quarter-wave table with a third-order correction. */
#ifndef PHASELEAD_CORE_SINE_H
#define PHASELEAD_CORE_SINE_H

#include <stdint.h>

/* sin(2 pi phase / 2^32) in q30. Within 1.01 LSB of the exact value (every phase of a quarter turn was compared), odd
 * and symmetric to the bit, exact at the quarter turns. */
int32_t sine_q30(uint32_t phase_turn32);

#endif
