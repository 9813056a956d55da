#include "app/device_tick.h"

#include <string.h>

#include "app/axes.h"
#include "app/motion.h"
#include "app/reaction.h"
#include "app/triggers.h"

static void watch_host(struct device *device)
{
    const struct control *control = &device->control;
    bool driving = control->state == WIRE_STATE_ARMED || control->state == WIRE_STATE_RUNNING;
    if (driving && !device->host_is_recorded && control->timeout_ticks != 0 &&
        control->tick - control->heard_tick >= control->timeout_ticks)
        device_fault(device, WIRE_FAULT_HOST_TIMEOUT, NO_AXIS, 0);
}

/* In every mode: where an axis may be does not depend on what drives it. */
static void watch_ranges(struct device *device, uint32_t moving)
{
    struct control *control = &device->control;
    for (unsigned axis = 0; axis < AXES; axis++) {
        struct axis_state *state = &control->axis[axis];
        if (is_in(moving, axis) && control->state == WIRE_STATE_RUNNING && state->drive == DRIVE_PATH &&
            !axis_watch_range(&control->config[axis], state, device->adc_codes[axis]))
            device_fault(device, WIRE_FAULT_POSITION_LIMIT, axis, device->adc_codes[axis]);
    }
}

/* A loop that can no longer see where it is, or that no longer gets where it should be, must not go on pushing. */
static void watch_loops(struct device *device, uint32_t moving, const int32_t error_q16[AXES])
{
    static const uint8_t FAULTS[] = {[WATCH_FINE] = WIRE_FAULT_NONE,
                                     [WATCH_RAIL] = WIRE_FAULT_ADC_RAIL,
                                     [WATCH_JUMPED] = WIRE_FAULT_SENSOR_JUMP,
                                     [WATCH_FROZEN] = WIRE_FAULT_SENSOR_FROZEN,
                                     [WATCH_ERROR] = WIRE_FAULT_TRACKING_ERROR,
                                     [WATCH_LIMITED] = WIRE_FAULT_OUTPUT_LIMITED,
                                     [WATCH_OSCILLATION] = WIRE_FAULT_OSCILLATION};
    struct control *control = &device->control;
    for (unsigned axis = 0; axis < AXES; axis++) {
        struct axis_state *state = &control->axis[axis];
        const struct axis_config *config = &control->config[axis];
        if (!is_in(moving, axis) || control->state != WIRE_STATE_RUNNING || state->drive != DRIVE_PATH)
            continue;
        enum watch_finding found =
            axis_mode_has_feedback(config->mode)
                ? axis_watch(config, state, device->adc_codes[axis], error_q16[axis], &device->traces[axis])
                : axis_watch_codes(config, state, device->adc_codes[axis]);
        if (found != WATCH_FINE)
            device_fault(device, (enum wire_fault)FAULTS[found], axis, device->adc_codes[axis]);
    }
}

/* The trace of an axis at rest has no end of a path. */
static void note_ended_paths(struct device *device)
{
    uint32_t done = 0;
    for (unsigned axis = 0; axis < AXES; axis++)
        done |= device->traces[axis].path_done ? 1u << axis : 0;
    if (done == 0)
        return;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(done, axis))
            device->path_done_tick[axis] = device->control.tick;
    atomic_fetch_or_explicit(&device->path_done, done, memory_order_relaxed);
}

static void device_drive_outputs(struct device *device, uint16_t dac_codes[AXES])
{
    if (device->port.drive)
        device->port.drive(device->port.context, device->dac_codes);
    else
        memcpy(dac_codes, device->dac_codes, sizeof device->dac_codes);
}

static void record(struct device *device)
{
    const uint64_t tick = device->control.tick;
    const uint32_t trigger = device->control.pulsing | (device->trigger_edge ? TRIGGER_EDGE : 0);
    const bool drops = recorder_tick(&device->recorder, tick, device->adc_codes, device->traces, (uint8_t)trigger);
    transient_tick(&device->transient, tick, device->adc_codes, device->traces, device->control.config);
    if (drops)
        events_put(&device->events, tick, WIRE_EVENT_KIND_STREAM_OVERFLOW, (uint32_t)device->recorder.dropped);
}

void device_tick(struct device *device, const uint16_t adc_codes[AXES], uint16_t dac_codes[AXES])
{
    int32_t error_q16[AXES];
    device_take_raised(device);
    watch_host(device);
    memcpy(device->adc_codes, adc_codes, sizeof device->adc_codes);

    const uint32_t moving = axes_moving(device);
    axes_find_errors(device, moving, error_q16);
    axes_step(device, moving, error_q16);
    device_drive_outputs(device, dac_codes);

    axes_follow_outputs(device, moving);
    axes_watch_targets(device, moving);
    watch_loops(device, moving, error_q16);
    watch_ranges(device, moving);
    note_ended_paths(device);
    if (device->control.state == WIRE_STATE_STOPPING && device_at_rest_mask(device) == ALL_AXES)
        device_event(device, EVENT_AT_REST, 0);
    record(device);
    device->control.tick++;
    motion_move_on(device);
    device->trigger_edge = false;
    axes_set_targets(device);
    triggers_set_outputs(device);
}

void device_input(struct device *device)
{
    transient_trigger(&device->transient, WIRE_TRIGGER_INPUT, device->control.tick, device->control.config);
}

void device_trigger_edge(struct device *device)
{
    device->trigger_edge = true;
}

void device_put_path_events(struct device *device)
{
    if (atomic_load_explicit(&device->path_done, memory_order_relaxed) == 0)
        return;
    device_lock(device);
    uint32_t done = atomic_exchange_explicit(&device->path_done, 0, memory_order_relaxed);
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(done, axis))
            events_put(&device->events, device->path_done_tick[axis], WIRE_EVENT_KIND_PATH_DONE, axis);
    device_unlock(device);
}

void device_miss_ticks(struct device *device, uint32_t ticks)
{
    device->control.tick += ticks;
    recorder_miss(&device->recorder, ticks);
}

void device_lose_ticks(struct device *device, uint32_t ticks)
{
    device->lost_ticks += ticks;
    device_miss_ticks(device, ticks);
    device_raise(device, WIRE_FAULT_TICK_LOST, NO_AXIS, ticks);
}
