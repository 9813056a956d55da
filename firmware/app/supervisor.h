/* What the device may do next, as one table: state x event -> state, action; and what each fault makes it do. */
#ifndef PHASELEAD_APP_SUPERVISOR_H
#define PHASELEAD_APP_SUPERVISOR_H

#include "app/wire.h"

enum supervisor_event {
    EVENT_ARM,
    EVENT_START,
    EVENT_PARK,
    EVENT_STOP,
    EVENT_AT_REST, /* every output has reached its safe value */
    EVENT_CLEAR,
    EVENT_CLEAR_EARLY, /* asked to clear a fault while an output is not at its safe value */
    EVENT_FAULT_HOLD,
    EVENT_FAULT_RAMP,
    EVENT_CORE_LOST, /* found at boot: the hardware has put the outputs to zero */
    EVENT_COUNT
};

enum supervisor_action {
    ACTION_NONE,
    ACTION_REFUSE,       /* answers wrong_state */
    ACTION_REFUSE_FAULT, /* answers fault_latched */
    ACTION_START,        /* the chosen axes begin their paths */
    ACTION_HOLD,         /* every output stays where it is */
    ACTION_RAMP,         /* every output goes to its safe value at its ramp */
    ACTION_COUNT
};

struct supervisor_step {
    uint8_t state; /* enum wire_state */
    uint8_t action;
};

struct fault_reaction {
    const char *name;
    uint8_t event; /* enum supervisor_event */
};

extern const char *const SUPERVISOR_STATE_NAMES[];
extern const char *const SUPERVISOR_EVENT_NAMES[];
extern const char *const SUPERVISOR_ACTION_NAMES[];
extern const struct fault_reaction FAULT_REACTIONS[]; /* by enum wire_fault; none reacts like hold */

struct supervisor_step supervisor_step(enum wire_state state, enum supervisor_event event);

#endif
