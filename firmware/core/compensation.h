/* The feed-forward of modes inverse and inverse+pid: the stage's chain, undone from its end to its beginning.
 *
 *     position ahead -> shape (sensor, mechanics) -> creep undone -> plays and dead zones undone -> drive (amplifier)
 *
 * The delay is undone by looking ahead. The memory (plays, creep) follows the output in every tick and mode, so that it
 * agrees with the stage's when an inverse mode begins.
 */
#ifndef PHASELEAD_CORE_COMPENSATION_H
#define PHASELEAD_CORE_COMPENSATION_H

#include "core/biquad.h"
#include "core/creep.h"
#include "core/inverse.h"

#define SHAPE_SECTIONS 6
#define DRIVE_IN_USE (1u << SHAPE_SECTIONS)

struct compensation { /* of one axis, made when a model is committed */
    uint32_t preview_ticks_q16;
    int32_t rest_q16;         /* position at rest at 0 V */
    int64_t rest_q40;         /* the same in another format */
    uint32_t sections_in_use; /* those that change anything: bit i for shape[i], and DRIVE_IN_USE */
    int32_t per_um_q28;       /* V/um of the largest motion that other axes cause: inverse_per_um_q28() */
    struct biquad_config shape[SHAPE_SECTIONS];
    struct biquad_config drive;
    struct creep_config creep;
    struct inverse_config inverse;
};

struct compensation_state {
    struct biquad_state shape[SHAPE_SECTIONS];
    struct biquad_state drive;
    struct creep_state creep;
    struct inverse_state inverse;
    uint32_t primed; /* 0: shape and drive begin at their next input as if it had always been there */
    uint32_t reserved;
};

/* Works out rest_q16, rest_q40 and sections_in_use from the others. False when the position at rest does not fit. This
 * and the next two are not for the tick. */
bool compensation_make(struct compensation *compensation);

/* A stage at rest at 0 V that begins to follow u. */
void compensation_rest(const struct compensation *compensation, struct compensation_state *state, int32_t u_q24);

/* A state that came from elsewhere may hold anything: brings it within what a step takes. */
void compensation_admit(const struct compensation *compensation, struct compensation_state *state);

/* A tick in which something else decided the output. */
void compensation_follow(const struct compensation *compensation, struct compensation_state *state, int32_t u_q24);

/* Where the stage stands by the memory: asked for that, a step gives the present output again. 0 without a model. */
int32_t compensation_here_q16(const struct compensation *compensation, const struct compensation_state *state);

/* The voltage for the position that is wanted one preview from now, |ahead| < 32768 um. `most_q24`: that the output may
 * change in a tick. */
int32_t compensation_step_q24(const struct compensation *compensation, struct compensation_state *state,
                              int32_t ahead_q16, int32_t most_q24, bool *saturated);

#endif
