/* Marks on the path of an axis, at which a trigger output pulses: the lines and pixels of a scan, a step that has
 * settled. Worked out between two ticks, for the one to come, once its reference is known.
 *
 * A mark falls into the tick that is nearest to it. Holds and joins have none; but TARGET has, wherever the axis is
 * driven. */
#ifndef PHASELEAD_CORE_TRIGGER_H
#define PHASELEAD_CORE_TRIGGER_H

#include "core/axis_state.h"

enum trigger_mark {
    TRIGGER_NONE,
    TRIGGER_TURN,  /* a periodic path begins, and every so manieth part of a turn from there */
    TRIGGER_TIME,  /* a path begins, and every so many ticks from there */
    TRIGGER_WAY,   /* the reference passes one of the places that are so far apart */
    TRIGGER_TARGET /* once after each change of the reference: it rests, and the axis is there */
};

#define TRIGGER_WAY_LEAST 128 /* 2 nm in q16: the number of a place fits 32 bits wherever the reference is */

struct trigger_config { /* fixed-size fields, no padding: part of the control state that is read back */
    uint8_t mark;       /* enum trigger_mark */
    uint8_t axis;
    uint8_t rising; /* WAY: 1: on the way up alone */
    uint8_t reserved;
    uint32_t every; /* TURN: marks a turn; TIME: ticks, not 0; WAY: places in an LSB, q32; they are TRIGGER_WAY_LEAST or
                       further apart */
    int32_t origin; /* WAY: one of the places, um q16, or V q24 in mode open */
};

struct trigger_state {
    uint32_t mark;     /* TURN: how far the path is from a mark to the next, q32; TIME: ticks to the next, 0: none is to
                          come; WAY: number of the place before; TARGET: ticks that the reference has rested, UINT32_MAX: it
                          has pulsed since then */
    int32_t reference; /* TARGET: of the tick before */
};

struct trigger {
    struct trigger_config config;
    struct trigger_state state;
};

_Static_assert(sizeof(struct trigger) == 20, "trigger is padded");

/* Its first mark is yet to come, also where the axis is under way. */
void trigger_set(struct trigger *trigger, const struct trigger_config *config, const struct axis_state *axis);

/* Whether it pulses in the tick to come, for which the axis of its path has been given its target. */
bool trigger_step(struct trigger *trigger, const struct axis_config *config, const struct axis_state *axis);

#endif
