/* Whether a loop runs away: the energy of its error above the loop's band grows exponentially, block after block.
 *
 * The error is high-passed, and its energy summed over blocks of 1, 2, 4, 8, 16 and 32 ms, a runaway of each pace. A
 * block grows when it has at least twice the energy of the one before, a change of sign in it or in that one, and more
 * than OSCILLATION_SENSITIVITY^2 times the energy that the reference has there. OSCILLATION_BLOCKS that grow in a row,
 * up to an amplitude that matters, are an oscillation. What a stable loop does never gives so many: a step gives two
 * and then decays; a resonance that is driven grows linearly at most, which doubles the energy of four blocks in a row,
 * with noise of five; a push, however it grows, does not change its sign (tests/core/test_oscillation.py). Nothing of
 * it depends on gains or on the stage.
 */
#ifndef PHASELEAD_CORE_OSCILLATION_H
#define PHASELEAD_CORE_OSCILLATION_H

#include <stdbool.h>
#include <stdint.h>

#define OSCILLATION_ORDER 3  /* of the high-pass */
#define OSCILLATION_SCALES 6 /* of blocks */
#define OSCILLATION_BLOCKS 6
/* The host refuses gains whose peak sensitivity is above 6: so much more of the reference may be in the error. */
#define OSCILLATION_SENSITIVITY 6

struct oscillation_filter {
    int32_t low[OSCILLATION_ORDER]; /* the low-passed input of each stage, times 8 */
};

struct oscillation_block {
    uint64_t energy, reference_energy; /* so far; um^2 q16, summed over ticks */
    uint64_t before;                   /* energy of the block before */
    uint32_t parts;                    /* of it that have passed */
    uint32_t sign_changed;
    uint32_t grown; /* blocks in a row */
    uint32_t sign_changed_before;
};

struct oscillation_state {
    struct oscillation_filter error, reference;
    struct oscillation_block blocks[OSCILLATION_SCALES];
    int32_t last_q16; /* high-passed error */
    uint32_t primed;  /* 0: the filters are to begin at rest with the first tick */
};

/* Once a tick, all um q16. `limit`: rms of the high-passed error above which an oscillation matters. True in the tick
 * in which one is found. Signals beyond +-512 um count as 512. */
bool oscillation_step(struct oscillation_state *state, int32_t limit_q16, int32_t error_q16, int32_t reference_q16);

#endif
