/* Whether a loop runs away: the energy of its error above the loop's band grows exponentially, block after block, or
 * stays.
 *
 * The error is high-passed, and its energy summed over blocks of 1, 2, 4, 8, 16 and 32 ms, a runaway of each pace. A
 * block grows when it has at least twice the energy of the one before, a change of sign, and more than
 * OSCILLATION_SENSITIVITY^2 times the energy that the reference has there. OSCILLATION_BLOCKS that grow in a row, up to
 * an amplitude that matters, are an oscillation, and so are fewer that together weigh OSCILLATION_WEIGHT, where
 * fourfold growth counts twice. What a stable loop does gives no such row: a step gives two blocks and then decays; a
 * resonance that the path drives grows linearly at most, which doubles four blocks in a row, and those begin with what
 * the path explains; a push, however it grows, does not change its sign (tests/core/test_oscillation.py).
 *
 * A loop that grows too slowly for that ends in a limit cycle, where the slew limit holds it. So OSCILLATION_LOUD of
 * the longest blocks in a row, half a second, are one too, when each has the amplitude that matters, a change of sign
 * and more than OSCILLATION_QUALITY^2 times the energy of the reference, and none less than half the energy of one
 * before it: what rings down decays. Nothing of it depends on gains or on the stage.
 */
#ifndef PHASELEAD_CORE_OSCILLATION_H
#define PHASELEAD_CORE_OSCILLATION_H

#include <stdbool.h>
#include <stdint.h>

#define OSCILLATION_ORDER 3  /* of the high-pass */
#define OSCILLATION_SCALES 6 /* of blocks */
#define OSCILLATION_BLOCKS 6
#define OSCILLATION_WEIGHT 8
#define OSCILLATION_LOUD 16
/* The host refuses gains whose peak sensitivity is above 6: so much more of the reference may be in the error. */
#define OSCILLATION_SENSITIVITY 6
/* A path that drives a mode has an error of up to 1 / (2 zeta) of it: 25 for the built-in stage; and as much again. */
#define OSCILLATION_QUALITY 50

struct oscillation_filter {
    int32_t low[OSCILLATION_ORDER]; /* the low-passed input of each stage, times 8 */
};

struct oscillation_block {
    uint32_t energy, reference_energy; /* so far: um^2 q12, summed over ticks */
    uint32_t before;                   /* energy of the block before */
    uint8_t parts;                     /* of it that have passed */
    uint8_t sign_changed;
    uint8_t grown, weight; /* of blocks in a row; once there were enough they stay */
};

struct oscillation_state {
    struct oscillation_filter error, reference;
    struct oscillation_block blocks[OSCILLATION_SCALES];
    int32_t last_q16; /* high-passed error */
    uint32_t loudest; /* energy, of the longest blocks in a row that were loud */
    uint8_t loud;     /* their number, at most OSCILLATION_LOUD */
    uint8_t primed; /* 0: all but the parts of the first block is to be cleared, and the filters are to begin at rest */
    uint16_t over;  /* scales whose block is over, bit by bit: they are judged in the next tick */
};

/* Begins anew with the next step, which clears the rest. */
void oscillation_start(struct oscillation_state *state);

/* After a start. So many of the first block's ticks (below 5) count as over: for axes that begin together, so that the
 * ends of their blocks lie in different ticks. */
void oscillation_stagger(struct oscillation_state *state, unsigned ticks);

/* Once a tick, all um q16. `limit`: rms of the high-passed error above which an oscillation matters. True in the tick
 * in which one is found. Signals beyond +-512 um, and what is left of them beyond +-63, count as such. */
bool oscillation_step(struct oscillation_state *state, int32_t limit_q16, int32_t error_q16, int32_t reference_q16);

#endif
