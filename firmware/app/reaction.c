#include "app/reaction.h"

#include "app/axes.h"

enum wire_status device_event(struct device *device, enum supervisor_event event, uint8_t axis_mask)
{
    struct control *control = &device->control;
    struct supervisor_step step = supervisor_step((enum wire_state)control->state, event);
    switch ((enum supervisor_action)step.action) {
    case ACTION_REFUSE:
        return WIRE_STATUS_WRONG_STATE;
    case ACTION_REFUSE_FAULT:
        return WIRE_STATUS_FAULT_LATCHED;
    case ACTION_START:
        transient_arm_again(&device->transient);
        transient_trigger(&device->transient, WIRE_TRIGGER_SET_POINT, control->tick, control->config);
        axes_start(device, axis_mask);
        break;
    case ACTION_HOLD:
        axes_leave_paths(device, DRIVE_HOLD);
        break;
    case ACTION_RAMP:
        axes_leave_paths(device, DRIVE_RAMP);
        break;
    case ACTION_NONE:
    case ACTION_COUNT:
        break;
    }
    if (step.state != control->state) {
        control->state = step.state;
        events_put(&device->events, control->tick, WIRE_EVENT_KIND_STATE_CHANGE, step.state);
    }
    return WIRE_STATUS_OK;
}

void device_fault(struct device *device, enum wire_fault fault, unsigned axis, uint32_t detail)
{
    struct control *control = &device->control;
    if (control->fault == WIRE_FAULT_NONE) { /* the first one stays: the rest may be its consequences */
        control->fault = fault;
        control->fault_axis = axis;
        control->fault_detail = detail;
        control->fault_tick = control->tick;
        device->last_fault = fault;
        device->last_fault_detail = detail;
        events_put(&device->events, control->tick, WIRE_EVENT_KIND_FAULT, fault);
        fault_log_put(device->port.fault_log,
                      (struct wire_logged_fault){.power_cycle = device->journal.newest.power_cycle,
                                                 .tick = control->fault_tick,
                                                 .detail = control->fault_detail,
                                                 .fault = (uint8_t)control->fault,
                                                 .axis = (uint8_t)control->fault_axis,
                                                 .state = (uint8_t)control->state});
        recorder_freeze(&device->recorder);
        transient_trigger(&device->transient, WIRE_TRIGGER_FAULT, control->tick, control->config);
    }
    device_event(device, (enum supervisor_event)FAULT_REACTIONS[fault].event, 0);
}

void device_raise(struct device *device, enum wire_fault fault, unsigned axis, uint32_t detail)
{
    uint32_t none = WIRE_FAULT_NONE;
    device->raised_as[fault].axis = axis;
    device->raised_as[fault].detail = detail;
    atomic_compare_exchange_strong_explicit(&device->raised_first, &none, fault, memory_order_relaxed,
                                            memory_order_relaxed);
    atomic_fetch_or_explicit(&device->raised, 1u << fault, memory_order_release);
}

static void take_fault(struct device *device, uint32_t raised, unsigned fault)
{
    if ((raised >> fault & 1u) != 0)
        device_fault(device, (enum wire_fault)fault, device->raised_as[fault].axis, device->raised_as[fault].detail);
}

void device_take_raised(struct device *device)
{
    if (atomic_load_explicit(&device->raised, memory_order_relaxed) == 0)
        return;
    uint32_t raised = atomic_exchange_explicit(&device->raised, 0, memory_order_acquire);
    uint32_t first = atomic_exchange_explicit(&device->raised_first, WIRE_FAULT_NONE, memory_order_relaxed);
    take_fault(device, raised, first);
    for (unsigned fault = 1; fault < WIRE_FAULT_COUNT; fault++)
        if (fault != first)
            take_fault(device, raised, fault);
}
