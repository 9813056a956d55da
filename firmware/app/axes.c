#include "app/axes.h"

#include "core/decouple.h"
#include "core/fixed.h"

uint32_t axes_moving(const struct device *device)
{
    return ~device->resting & ALL_AXES;
}

/* Takes from each axis of the mask what the others of it cause there. */
static void decouple_axes(struct device *device, uint32_t mask, int32_t values_q16[AXES])
{
    const struct model_slot *slot = model_store_active(&device->models);
    bool saturated = false;
    decouple(slot != NULL ? &slot->decoupling : NULL, mask, values_q16, &saturated);
    for (unsigned axis = 0; axis < AXES; axis++)
        if (saturated && is_in(mask, axis))
            device->control.axis[axis].target.flags |= TARGET_SATURATED;
}

/* The voltages for where the axes shall be and, of those that have no inverse, for what the others cause there now. Of
 * those that have, it is known where they will be. Only axes that follow a path count: the sensor of another may not be
 * there. */
static void lead_axes(struct device *device, uint32_t to_invert, uint32_t to_lead)
{
    int32_t here_q16[AXES], alone_q16[AXES];
    uint32_t driven = 0;
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct axis_state *state = &device->control.axis[axis];
        bool saturated = false;
        if (state->drive == DRIVE_PATH)
            driven |= 1u << axis;
        here_q16[axis] = state->target.ahead_q16;
        if ((state->target.flags & TARGET_INVERSE) == 0)
            here_q16[axis] =
                converter_position_q16(&device->control.config[axis].converter, device->adc_codes[axis], &saturated);
        alone_q16[axis] = here_q16[axis];
    }
    decouple_axes(device, driven, alone_q16);
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(to_invert, axis))
            axis_invert(&device->control.config[axis], &device->model_of[axis], &device->control.axis[axis],
                        alone_q16[axis]);
        else if (is_in(to_lead, axis))
            axis_lead_by(&device->model_of[axis], &device->control.axis[axis],
                         sub_i32(alone_q16[axis], here_q16[axis]));
}

void axes_set_targets(struct device *device)
{
    const uint32_t moving = axes_moving(device);
    uint32_t to_invert = 0, to_lead = 0;
    for (unsigned axis = 0; axis < AXES; axis++) {
        struct axis_state *state = &device->control.axis[axis];
        if (!is_in(moving, axis) || !axis_needs_target(state))
            continue;
        if (axis_set_target(&device->control.config[axis], &device->model_of[axis], state))
            to_invert |= 1u << axis;
        else if (axis_has_feedback(state))
            to_lead |= 1u << axis;
    }
    if ((to_invert | to_lead) != 0)
        lead_axes(device, to_invert, to_lead);
}

void axes_find_errors(struct device *device, uint32_t moving, int32_t error_q16[AXES])
{
    uint32_t inverting = 0;
    for (unsigned axis = 0; axis < AXES; axis++) {
        struct axis_state *state = &device->control.axis[axis];
        error_q16[axis] = 0;
        if (!is_in(moving, axis) || !axis_has_feedback(state))
            continue;
        error_q16[axis] = axis_error_q16(&device->control.config[axis], state, device->adc_codes[axis]);
        inverting |= (state->target.flags & TARGET_INVERSE) != 0 ? 1u << axis : 0;
    }
    decouple_axes(device, inverting, error_q16);
}

void axes_step(struct device *device, uint32_t moving, const int32_t error_q16[AXES])
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        struct axis_trace *trace = &device->traces[axis];
        if (!is_in(moving, axis))
            continue;
        if (axis_step(&device->control.config[axis], &device->control.axis[axis], error_q16[axis], trace))
            device->resting |= 1u << axis;
        device->dac_codes[axis] = trace->dac_code;
    }
}

void axes_watch_targets(struct device *device, uint32_t moving)
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        struct axis_state *state = &device->control.axis[axis];
        if (is_in(moving, axis) && state->drive == DRIVE_PATH)
            axis_watch_target(&device->control.config[axis], state, device->adc_codes[axis], &device->traces[axis]);
    }
}

void axes_follow_outputs(struct device *device, uint32_t moving)
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        struct axis_state *state = &device->control.axis[axis];
        if (!is_in(moving, axis))
            continue;
        extremes_follow(&device->driven[axis], state->u_q24);
        if (axis_follow_output(&device->model_of[axis], state, &device->traces[axis]))
            device_wake(device, axis);
    }
}

uint32_t axes_enter_ticks(const struct device *device, uint32_t mask)
{
    uint32_t longest = 0;
    for (unsigned axis = 0; axis < AXES; axis++) {
        const uint32_t ticks = axis_enter_ticks(&device->control.config[axis], &device->model_of[axis]);
        longest = is_in(mask, axis) && ticks > longest ? ticks : longest;
    }
    return longest;
}

void axes_start(struct device *device, uint8_t axis_mask)
{
    const uint32_t enter_ticks = axes_enter_ticks(device, axis_mask);
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(axis_mask, axis)) {
            device_wake(device, axis);
            const struct path_config *path = &device->control.config[axis].path;
            if ((path->flags & PATH_FROM_HERE) != 0 ||
                (path->kind == PATH_WAVE && device->control.points[axis].ring != POINTS_NO_RING))
                device->control.path_mask &= ~(1u << axis); /* from where it is now, and not a second time */
            axis_start(&device->control.axis[axis]);
            oscillation_stagger(&device->control.axis[axis].oscillation, axis);
            axis_enter(&device->control.config[axis], &device->model_of[axis], &device->control.axis[axis],
                       device->adc_codes[axis], enter_ticks);
        }
}

void axes_couple_joins(struct device *device, uint8_t axis_mask)
{
    const struct model_slot *slot = model_store_active(&device->models);
    int32_t seen_q16[AXES], rest_q16[AXES] = {0};
    uint32_t inverting = 0;
#pragma GCC unroll 1 /* the flash is short of room */
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct axis_config *config = &device->control.config[axis];
        const struct compensation *compensation = device->model_of[axis].compensation;
        bool saturated = false;
        seen_q16[axis] = converter_position_q16(&config->converter, device->adc_codes[axis], &saturated);
        if (compensation == NULL || !axis_mode_inverts(config->mode))
            continue;
        rest_q16[axis] = compensation->rest_q16;
        seen_q16[axis] = sub_i32(device->control.axis[axis].join.ahead_q16, rest_q16[axis]);
        inverting |= axis_mask & 1u << axis;
    }
    if (slot == NULL || inverting == 0)
        return;
    couple((const int32_t (*)[AXES])slot->coupling_q28, axis_mask, seen_q16);
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(inverting, axis))
            device->control.axis[axis].join.ahead_q16 = add_i32(seen_q16[axis], rest_q16[axis]);
}

void axes_leave_paths(struct device *device, enum axis_drive drive)
{
    device->resting = 0;
    for (unsigned axis = 0; axis < AXES; axis++) {
        device->control.axis[axis].drive = drive;
        device->control.axis[axis].path.running = 0;
        device->control.axis[axis].join.step_turn64 = 0;
        segment_drop_all(&device->control.queue[axis]);
    }
}
