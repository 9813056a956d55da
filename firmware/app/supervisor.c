#include "app/supervisor.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

const char *const SUPERVISOR_STATE_NAMES[] = {"parked", "armed", "running", "stopping", "fault"};
const char *const SUPERVISOR_EVENT_NAMES[] = {"arm",   "start",       "park",       "stop",       "at_rest",
                                              "clear", "clear_early", "fault_hold", "fault_ramp", "core_lost"};
const char *const SUPERVISOR_ACTION_NAMES[] = {"none", "refuse", "refuse_fault", "start", "hold", "ramp"};
_Static_assert(COUNT(SUPERVISOR_STATE_NAMES) == WIRE_STATE_COUNT, "a state without a name");
_Static_assert(COUNT(SUPERVISOR_EVENT_NAMES) == EVENT_COUNT, "an event without a name");
_Static_assert(COUNT(SUPERVISOR_ACTION_NAMES) == ACTION_COUNT, "an action without a name");

/* A stage that is only badly controlled is safest where it stands; one whose sensor, clock or host is gone goes home
 * on the one thing that still works, the open-loop ramp. */
const struct fault_reaction FAULT_REACTIONS[] = {
    [WIRE_FAULT_NONE] = {"hold", EVENT_FAULT_HOLD},
    [WIRE_FAULT_HOST_TIMEOUT] = {"ramp", EVENT_FAULT_RAMP},
    [WIRE_FAULT_TICK_OVERRUN] = {"ramp", EVENT_FAULT_RAMP},
    [WIRE_FAULT_ADC_RAIL] = {"ramp", EVENT_FAULT_RAMP},
    [WIRE_FAULT_CONVERTER_SILENT] = {"ramp", EVENT_FAULT_RAMP},
    [WIRE_FAULT_INTERLOCK] = {"ramp", EVENT_FAULT_RAMP},
    [WIRE_FAULT_FLASH_ERROR] = {"hold", EVENT_FAULT_HOLD}, /* written while nothing moves */
    [WIRE_FAULT_CORE_LOST] = {"core-lost", EVENT_CORE_LOST},
    [WIRE_FAULT_TRACKING_ERROR] = {"hold", EVENT_FAULT_HOLD},
    [WIRE_FAULT_TICK_LOST] = {"ramp", EVENT_FAULT_RAMP},
    [WIRE_FAULT_SENSOR_FROZEN] = {"ramp", EVENT_FAULT_RAMP},
    [WIRE_FAULT_SENSOR_JUMP] = {"ramp", EVENT_FAULT_RAMP},
    [WIRE_FAULT_OUTPUT_LIMITED] = {"ramp", EVENT_FAULT_RAMP},
    [WIRE_FAULT_OSCILLATION] = {"ramp", EVENT_FAULT_RAMP},
    [WIRE_FAULT_POSITION_LIMIT] = {"ramp", EVENT_FAULT_RAMP},
};
_Static_assert(COUNT(FAULT_REACTIONS) == WIRE_FAULT_COUNT, "a fault without a reaction");

#define PARKED WIRE_STATE_PARKED
#define ARMED WIRE_STATE_ARMED
#define RUNNING WIRE_STATE_RUNNING
#define STOPPING WIRE_STATE_STOPPING
#define FAULT WIRE_STATE_FAULT

/* In a fault, park and stop still bring a held output home; the first fault's hold never stops a later ramp. */
static const struct supervisor_step TRANSITIONS[WIRE_STATE_COUNT][EVENT_COUNT] =
    {
        [PARKED] =
            {
                [EVENT_ARM] = {ARMED, ACTION_RAMP},
                [EVENT_START] = {PARKED, ACTION_REFUSE},
                [EVENT_PARK] = {PARKED, ACTION_RAMP},
                [EVENT_STOP] = {PARKED, ACTION_HOLD},
                [EVENT_AT_REST] = {PARKED, ACTION_NONE},
                [EVENT_CLEAR] = {PARKED, ACTION_REFUSE},
                [EVENT_CLEAR_EARLY] = {PARKED, ACTION_REFUSE},
                [EVENT_FAULT_HOLD] = {FAULT, ACTION_HOLD},
                [EVENT_FAULT_RAMP] = {FAULT, ACTION_RAMP},
                [EVENT_CORE_LOST] = {FAULT, ACTION_RAMP},
            },
        [ARMED] =
            {
                [EVENT_ARM] = {ARMED, ACTION_REFUSE},
                [EVENT_START] = {RUNNING, ACTION_START},
                [EVENT_PARK] = {STOPPING, ACTION_RAMP},
                [EVENT_STOP] = {STOPPING, ACTION_RAMP},
                [EVENT_AT_REST] = {ARMED, ACTION_NONE},
                [EVENT_CLEAR] = {ARMED, ACTION_REFUSE},
                [EVENT_CLEAR_EARLY] = {ARMED, ACTION_REFUSE},
                [EVENT_FAULT_HOLD] = {FAULT, ACTION_HOLD},
                [EVENT_FAULT_RAMP] = {FAULT, ACTION_RAMP},
                [EVENT_CORE_LOST] = {FAULT, ACTION_RAMP},
            },
        [RUNNING] =
            {
                [EVENT_ARM] = {RUNNING, ACTION_REFUSE},
                [EVENT_START] = {RUNNING, ACTION_REFUSE},
                [EVENT_PARK] = {STOPPING, ACTION_RAMP},
                [EVENT_STOP] = {STOPPING, ACTION_RAMP},
                [EVENT_AT_REST] = {RUNNING, ACTION_NONE},
                [EVENT_CLEAR] = {RUNNING, ACTION_REFUSE},
                [EVENT_CLEAR_EARLY] = {RUNNING, ACTION_REFUSE},
                [EVENT_FAULT_HOLD] = {FAULT, ACTION_HOLD},
                [EVENT_FAULT_RAMP] = {FAULT, ACTION_RAMP},
                [EVENT_CORE_LOST] = {FAULT, ACTION_RAMP},
            },
        [STOPPING] =
            {
                [EVENT_ARM] = {STOPPING, ACTION_REFUSE},
                [EVENT_START] = {STOPPING, ACTION_REFUSE},
                [EVENT_PARK] = {STOPPING, ACTION_RAMP},
                [EVENT_STOP] = {STOPPING, ACTION_RAMP},
                [EVENT_AT_REST] = {PARKED, ACTION_NONE},
                [EVENT_CLEAR] = {STOPPING, ACTION_REFUSE},
                [EVENT_CLEAR_EARLY] = {STOPPING, ACTION_REFUSE},
                [EVENT_FAULT_HOLD] = {FAULT, ACTION_RAMP}, /* already on the way home */
                [EVENT_FAULT_RAMP] = {FAULT, ACTION_RAMP},
                [EVENT_CORE_LOST] = {FAULT, ACTION_RAMP},
            },
        [FAULT] =
            {
                [EVENT_ARM] = {FAULT, ACTION_REFUSE_FAULT},
                [EVENT_START] = {FAULT, ACTION_REFUSE_FAULT},
                [EVENT_PARK] = {FAULT, ACTION_RAMP},
                [EVENT_STOP] = {FAULT, ACTION_RAMP},
                [EVENT_AT_REST] = {FAULT, ACTION_NONE},
                [EVENT_CLEAR] = {PARKED, ACTION_RAMP},
                [EVENT_CLEAR_EARLY] = {FAULT, ACTION_REFUSE},
                [EVENT_FAULT_HOLD] = {FAULT, ACTION_NONE},
                [EVENT_FAULT_RAMP] = {FAULT, ACTION_RAMP},
                [EVENT_CORE_LOST] = {FAULT, ACTION_RAMP},
            },
};

struct supervisor_step supervisor_step(enum wire_state state, enum supervisor_event event)
{
    return TRANSITIONS[state][event];
}
