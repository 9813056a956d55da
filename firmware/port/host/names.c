/* The supervisor's tables, for documentation and tests. */
#include "app/device.h"
#include "port/host/host.h"

const char *host_state_name(uint32_t state)
{
    return state < WIRE_STATE_COUNT ? SUPERVISOR_STATE_NAMES[state] : NULL;
}

const char *host_event_name(uint32_t event)
{
    return event < EVENT_COUNT ? SUPERVISOR_EVENT_NAMES[event] : NULL;
}

const char *host_action_name(uint32_t action)
{
    return action < ACTION_COUNT ? SUPERVISOR_ACTION_NAMES[action] : NULL;
}

const char *host_fault_reaction(uint32_t fault)
{
    return fault < WIRE_FAULT_COUNT ? FAULT_REACTIONS[fault].name : NULL;
}

uint32_t host_transition(uint32_t state, uint32_t event)
{
    struct supervisor_step step = supervisor_step((enum wire_state)state, (enum supervisor_event)event);
    return step.state | (uint32_t)step.action << 8;
}

size_t host_device_size(void)
{
    return sizeof(struct device);
}
