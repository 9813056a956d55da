#include "app/device.h"

#include <string.h>

#include "app/hard_limits.h"

/* Without a model: -2..10 V, 1000 V/s, parking at 50 V/s on 0 V; 16-bit converters over +-10.24 V and -10..270 um. */
static const struct axis_config DEFAULT_IDLE = {
    .u_park_q24 = 0,
    .ramp_q24 = 167772, /* 0.01 V a tick */
    .error_limit_q16 = 18350080 / 4,
    .error_ticks = MODEL_DEFAULT_ERROR_TICKS,
    .pid.d_alpha_q31 = PID_DERIVATIVE_UNFILTERED,
    .output = {.u_min_q24 = -(2 << 24), .u_max_q24 = 10 << 24, .slew_q24 = 3355443 /* 0.2 V a tick */},
    .converter = {.dac_zero_code = 32768,
                  .dac_codes_per_V_q16 = 209715200, /* 65536 / 20.48 V */
                  .adc_zero_q8 = 599186,            /* 10 um x 65536 / 280 um = 2340.57 */
                  .adc_um_per_code_q32 = 18350080 /* 280 um / 65536 */},
    .code_max = UINT16_MAX,
    .oscillation_limit_q16 = 18350080 / MODEL_DEFAULT_OSCILLATION,
};

void device_lock(const struct device *device)
{
    if (device->port.lock)
        device->port.lock(device->port.context);
}

void device_unlock(const struct device *device)
{
    if (device->port.unlock)
        device->port.unlock(device->port.context);
}

const struct feedforward_tables *device_tables(const struct device *device, unsigned axis)
{
    const struct model_slot *slot = model_store_active(&device->models);
    return slot && is_in(slot->table_mask, axis) ? &slot->tables[axis] : NULL;
}

const struct compensation *device_compensation(const struct device *device, unsigned axis)
{
    const struct model_slot *slot = model_store_active(&device->models);
    return slot && is_in(slot->inverse_mask, axis) ? &slot->compensation[axis] : NULL;
}

const int32_t *device_wave_q30(const struct device *device, unsigned axis)
{
    return is_in(device->wave_mask, axis) ? device->waves_q30[axis] : NULL;
}

void device_wake(struct device *device, unsigned axis)
{
    device->resting &= ~(1u << axis);
}

void device_link_models(struct device *device)
{
    device->resting = 0;
    for (unsigned axis = 0; axis < AXES; axis++)
        device->model_of[axis] = (struct axis_model){device_tables(device, axis), device_compensation(device, axis),
                                                     device_wave_q30(device, axis)};
}

void device_make_idle(struct device *device, const struct model_slot *slot, const struct wire_axis_limits limits[AXES])
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        device->idle[axis] = slot ? slot->idle[axis] : DEFAULT_IDLE;
        hard_limits_apply(&limits[axis], &device->idle[axis]);
    }
}

void device_make_idle_again(struct device *device)
{
    device_make_idle(device, model_store_active(&device->models), device->journal.newest.limits);
}

bool device_admits(const struct device *device)
{
    for (unsigned axis = 0; axis < AXES; axis++)
        if (!hard_limits_admit(&device->idle[axis], device->control.axis[axis].u_q24))
            return false;
    return true;
}

static void reset_axis(struct device *device, unsigned axis, const struct axis_config *idle)
{
    struct axis_config *config = &device->control.config[axis];
    struct axis_state *state = &device->control.axis[axis];
    const int32_t u_park_q24 = config->u_park_q24;
    *config = *idle;
    config->u_park_q24 = u_park_q24;
    memset(&state->path, 0, sizeof state->path);
    memset(&state->target, 0, sizeof state->target);
    state->join.step_turn64 = 0;
    segment_reset(&device->control.queue[axis]);
    memset(&device->control.points[axis], 0, sizeof device->control.points[axis]);
    memset(&device->motion_limits[axis], 0, sizeof device->motion_limits[axis]);
    pid_reset(&state->pid);
}

void device_take_safe_values(struct device *device)
{
    for (unsigned axis = 0; axis < AXES; axis++)
        device->control.config[axis].u_park_q24 = device->idle[axis].u_park_q24;
}

void device_reset_axes(struct device *device)
{
    device->control.path_mask = 0;
    device->resting = 0;
    device->control.pulsing = 0;
    for (unsigned i = 0; i < TRIGGERS; i++)
        device->control.trigger[i].config.mark = TRIGGER_NONE;
    for (unsigned axis = 0; axis < AXES; axis++)
        reset_axis(device, axis, &device->idle[axis]);
}

void device_begin_idle(struct device *device)
{
    device_reset_axes(device);
    for (unsigned axis = 0; axis < AXES && device->control.state == WIRE_STATE_PARKED; axis++)
        device->control.axis[axis].drive = DRIVE_HOLD;
}

void device_rest(struct device *device)
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        struct axis_state *state = &device->control.axis[axis];
        const struct compensation *compensation = device_compensation(device, axis);
        if (compensation)
            compensation_rest(compensation, &state->compensation, state->u_q24);
        else
            memset(&state->compensation, 0, sizeof state->compensation);
    }
}

uint8_t device_at_rest_mask(const struct device *device)
{
    unsigned mask = 0;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (device->control.axis[axis].u_q24 == device->control.config[axis].u_park_q24)
            mask |= 1u << axis;
    return (uint8_t)mask;
}

bool device_stands_still(const struct device *device)
{
    const unsigned at_rest = device_at_rest_mask(device);
    for (unsigned axis = 0; axis < AXES; axis++)
        if (!is_in(at_rest, axis) && device->control.axis[axis].drive != DRIVE_HOLD)
            return false;
    return true;
}

enum wire_status device_wants_still(const struct device *device)
{
    device_lock(device);
    const bool still = device_stands_still(device);
    device_unlock(device);
    return still ? WIRE_STATUS_OK : WIRE_STATUS_BUSY;
}
