/* Session, supervisor and what the device says about itself. */
#include <string.h>

#include "app/axes.h"
#include "app/command.h"
#include "app/path_check.h"
#include "app/reaction.h"
#include "core/fixed.h"

#define MODEL_LOADED 1u
#define MODEL_FALLBACK 2u
#define MODEL_PERSISTED 4u

static uint32_t model_crc(const struct device *device)
{
    const struct model_slot *slot = model_store_active(&device->models);
    return slot ? slot->crc : 0;
}

/* Whether the session's host holds the device. One that has switched its timeout off holds a path for as long as it
 * runs, but a device that is only armed no longer than HOST_TIMEOUT_TICKS after its last word. */
static bool is_held(const struct device *device)
{
    const struct control *control = &device->control;
    const bool running = control->state == WIRE_STATE_RUNNING;
    if (device->session == 0 || (!running && control->state != WIRE_STATE_ARMED))
        return false;
    if (control->timeout_ticks == 0 && running)
        return true;
    uint32_t ticks = control->timeout_ticks != 0 ? control->timeout_ticks : HOST_TIMEOUT_TICKS;
    return control->tick - control->heard_tick < ticks;
}

/* A new session inherits the model, the outputs, a latched fault and the transient recorder with its trigger, and
 * nothing else: whatever still moves is ramped to its safe value, and what the host before it had set, or had sent a
 * part of, is gone. */
static void begin_session(struct device *device, const struct wire_header *header)
{
    struct wire_event stale;
    uint16_t id;
    line_begin_session(&device->line, header->id);
    recorder_discard(&device->recorder);
    device->models.uploading = device->update.receiving = false;
    while (events_take(&device->events, &stale, &id))
        ;
    device->session = header->session;
    device->latched_valid = false;
    device->control.timeout_ticks = HOST_TIMEOUT_TICKS;
    if (device->control.state == WIRE_STATE_ARMED || device->control.state == WIRE_STATE_RUNNING)
        device_event(device, EVENT_PARK, 0);
    device->wave_mask = 0;
    device_link_models(device);
    device_reset_axes(device);
}

static uint8_t model_flags(const struct device *device)
{
    const struct model_store *models = &device->models;
    return (uint8_t)((models->loaded ? MODEL_LOADED : 0) | (models->fallback ? MODEL_FALLBACK : 0) |
                     (models->persisted ? MODEL_PERSISTED : 0));
}

enum wire_status command_hello(struct device *device, const struct request *request, struct answer *answer)
{
    const struct control *control = &device->control;
    enum wire_status status = WIRE_STATUS_OK;
    uint64_t session = request->header->session;
    if (session == 0)
        status = WIRE_STATUS_BAD_VALUE;
    else if (session != device->session && is_held(device))
        status = WIRE_STATUS_BUSY;
    else if (session != device->session)
        begin_session(device, request->header);
    if (status == WIRE_STATUS_OK)
        device->control.heard_tick = control->tick;
    struct wire_hello_reply reply = {.schema_fingerprint = WIRE_FINGERPRINT,
                                     .wire_version = WIRE_VERSION,
                                     .wire_revision = WIRE_REVISION,
                                     .tick_rate_Hz = TICK_RATE_HZ,
                                     .baud = device->port.baud,
                                     .axis_count = AXES,
                                     .state = (uint8_t)control->state,
                                     .reset_cause = (uint8_t)device->port.reset_cause,
                                     .model_flags = model_flags(device),
                                     .model_crc = model_crc(device),
                                     .max_payload = WIRE_MAX_PAYLOAD};
    memcpy(reply.build_id, device->port.build_id, sizeof reply.build_id);
    for (size_t i = 0; i < sizeof reply.target && device->port.target[i] != 0; i++)
        reply.target[i] = (uint8_t)device->port.target[i];
    wire_pack_hello_reply(&reply, answer->payload, answer->size);
    return status;
}

enum wire_status command_status(struct device *device, const struct request *request, struct answer *answer)
{
    const struct control *control = &device->control;
    struct wire_status_reply reply = {.state = (uint8_t)control->state,
                                      .fault = (uint8_t)control->fault,
                                      .fault_axis = (uint8_t)control->fault_axis,
                                      .fault_tick = control->fault_tick,
                                      .at_rest = device_at_rest_mask(device),
                                      .overruns = device->overruns,
                                      .stream_dropped = (uint32_t)device->recorder.dropped,
                                      .rx_errors = device->line.rx_errors,
                                      .model_crc = model_crc(device),
                                      .first_tick = control->first_tick};
    (void)request;
    for (unsigned axis = 0; axis < AXES; axis++) {
        if (control->axis[axis].path.running != 0)
            reply.running_axes |= (uint8_t)(1u << axis);
        reply.modes[axis] = (uint8_t)control->config[axis].mode;
        reply.adc_codes[axis] = device->adc_codes[axis];
        reply.dac_codes[axis] = device->dac_codes[axis];
        reply.saturations[axis] = control->axis[axis].saturations;
    }
    wire_pack_status_reply(&reply, answer->payload, answer->size);
    return WIRE_STATUS_OK;
}

enum wire_status command_arm(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_arm_request arm;
    (void)answer;
    wire_unpack_arm_request(&arm, request->payload, request->size);
    if (device->update.on_trial || device->update.restarting)
        return WIRE_STATUS_BUSY; /* it may restart by itself */
    if (device->control.state == WIRE_STATE_PARKED) {
        if (arm.model_crc != 0 && !device->models.loaded)
            return WIRE_STATUS_NO_MODEL;
        if (arm.model_crc != model_crc(device) && (arm.model_crc != 0 || device->models.fallback))
            return WIRE_STATUS_MUST_NAME_MODEL;
        if (device->journal.newest.limits_lost)
            return WIRE_STATUS_LIMITS_LOST;
        if (!device_admits(device))
            return WIRE_STATUS_OUTSIDE_LIMITS;
        device_take_safe_values(device);
    }
    return device_event(device, EVENT_ARM, 0);
}

static enum wire_status check_start(const struct device *device, unsigned axis)
{
    const struct axis_config *config = &device->control.config[axis];
    if (config->mode == AXIS_IDLE || !is_in(device->control.path_mask, axis) ||
        (config->path.kind == PATH_WAVE && !device_wave_q30(device, axis)))
        return WIRE_STATUS_BAD_VALUE;
    /* Its waveform may have come after the path was set. */
    return path_check_learned_for(device, axis, &config->path) ? WIRE_STATUS_OK : WIRE_STATUS_LEARNED_FOR_OTHER;
}

enum wire_status command_start(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_start_request start;
    wire_unpack_start_request(&start, request->payload, request->size);
    if (start.axis_mask == 0 || start.axis_mask >> AXES != 0)
        return WIRE_STATUS_BAD_VALUE;
    for (unsigned axis = 0; axis < AXES && device->control.state == WIRE_STATE_ARMED; axis++) {
        const enum wire_status checked = is_in(start.axis_mask, axis) ? check_start(device, axis) : WIRE_STATUS_OK;
        if (checked != WIRE_STATUS_OK)
            return checked;
    }
    const struct wire_start_reply reply = {.first_tick =
                                               device->control.tick + 1 + axes_enter_ticks(device, start.axis_mask)};
    wire_pack_start_reply(&reply, answer->payload, answer->size);
    const enum wire_status status = device_event(device, EVENT_START, start.axis_mask);
    if (status == WIRE_STATUS_OK)
        axes_couple_joins(device, start.axis_mask);
    return status;
}

enum wire_status command_park(struct device *device, const struct request *request, struct answer *answer)
{
    (void)request;
    (void)answer;
    return device_event(device, EVENT_PARK, 0);
}

enum wire_status command_stop(struct device *device, const struct request *request, struct answer *answer)
{
    (void)request;
    (void)answer;
    return device_event(device, EVENT_STOP, 0);
}

enum wire_status command_clear_fault(struct device *device, const struct request *request, struct answer *answer)
{
    bool at_rest = device_at_rest_mask(device) == ALL_AXES;
    (void)request;
    (void)answer;
    enum wire_status status = device_event(device, at_rest ? EVENT_CLEAR : EVENT_CLEAR_EARLY, 0);
    if (status == WIRE_STATUS_OK) {
        device->control.fault = WIRE_FAULT_NONE;
        device->control.fault_axis = NO_AXIS;
        device->control.fault_detail = 0;
    }
    return status;
}

enum wire_status command_set_timeout(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_set_timeout_request timeout;
    (void)answer;
    wire_unpack_set_timeout_request(&timeout, request->payload, request->size);
    device->control.timeout_ticks = timeout.ticks;
    return WIRE_STATUS_OK;
}

enum wire_status command_info(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_info_reply reply = {.cycles_last = device->cycles_last,
                                    .cycles_max = device->cycles_max,
                                    .overruns = device->overruns,
                                    .latched_late = device->latched_late,
                                    .lost_ticks = device->lost_ticks,
                                    .brown_out_level = device->port.brown_out_level,
                                    .last_fault = (uint8_t)device->last_fault,
                                    .last_fault_detail = device->last_fault_detail,
                                    .flash_sequence = device->models.sequence,
                                    .model_flags = model_flags(device),
                                    .model_crc = model_crc(device)};
    (void)request;
    memcpy(reply.histogram, device->cycles_histogram, sizeof reply.histogram);
    wire_pack_info_reply(&reply, answer->payload, answer->size);
    return WIRE_STATUS_OK;
}
