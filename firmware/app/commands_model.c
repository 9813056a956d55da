/* The model transaction, its read-back and its place in flash. */
#include <string.h>

#include "app/command.h"
#include "app/model_fields.h"
#include "app/reaction.h"
#include "core/fixed.h"
#include "core/inverse_memory.h"

enum wire_status command_model_begin(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_model_begin_request begin;
    (void)answer;
    wire_unpack_model_begin_request(&begin, request->payload, request->size);
    return model_store_begin(&device->models, begin.size, begin.crc);
}

enum wire_status command_model_chunk(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_model_chunk_request chunk;
    (void)answer;
    wire_unpack_model_chunk_request(&chunk, request->payload, request->size);
    return model_store_chunk(&device->models, chunk.offset, chunk.data, chunk.data_size);
}

/* Another calibration of the DAC changes its code, and so the output, although u stays. A step of the park ramp is
 * tolerated. Returns the field that is to blame, 0 for none. */
static uint16_t would_jump(const struct device *device)
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct axis_config *now = &device->control.config[axis];
        bool saturated = false;
        int32_t u_q24 = device->control.axis[axis].u_q24;
        int64_t jump = (int64_t)converter_dac_code(&device->idle[axis].converter, u_q24, &saturated);
        int64_t tolerated = floor_shift_i64((int64_t)now->ramp_q24 * now->converter.dac_codes_per_V_q16, 40) + 1;
        jump -= device->dac_codes[axis];
        if (jump > tolerated || jump < -tolerated)
            return (uint16_t)(100 * axis + (u_q24 == 0 ? FIELD_DAC_ZERO : FIELD_DAC_SCALE));
    }
    return 0;
}

static uint8_t held_back(const struct model_slot *slot, const struct axis_config idle[AXES])
{
    unsigned mask = 0;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (memcmp(&idle[axis].output, &slot->idle[axis].output, sizeof idle[axis].output) != 0)
            mask |= 1u << axis;
    return (uint8_t)mask;
}

/* What stands in the way of the new limits as the outputs are: one would jump, or there would be no way home. */
static enum wire_status check_outputs(const struct device *device, uint16_t *invalid_field)
{
    if (!device_admits(device))
        return WIRE_STATUS_OUTSIDE_LIMITS;
    *invalid_field = would_jump(device);
    return *invalid_field == 0 ? WIRE_STATUS_OK : WIRE_STATUS_MODEL_INVALID;
}

/* While no output moves, and so no tick changes it. */
static void recall(struct device *device)
{
    struct recalled *recalled = device->recalled;
    const struct model_slot *next = model_store_prepared(&device->models);
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct axis_state *state = &device->control.axis[axis];
        const struct compensation *now = device_compensation(device, axis);
        const struct compensation *then = &next->compensation[axis];
        recalled[axis] = (struct recalled){0};
        recalled[axis].creep = now && memcmp(&now->creep, &then->creep, sizeof then->creep) == 0;
        if (is_in(next->inverse_mask, axis) && now)
            inverse_recall(&then->inverse, &recalled[axis].inverse, &now->inverse, &state->compensation.inverse,
                           state->u_q24);
        else if (is_in(next->inverse_mask, axis))
            inverse_begin_after(&then->inverse, &recalled[axis].inverse, &device->driven[axis], state->u_q24);
    }
}

/* Short: ticks are kept out. */
static void take_memory(struct device *device)
{
    const struct recalled *recalled = device->recalled;
    for (unsigned axis = 0; axis < AXES; axis++) {
        struct compensation_state *state = &device->control.axis[axis].compensation;
        state->primed = 0; /* so that the first step primes the sections */
        state->inverse = recalled[axis].inverse;
        if (!recalled[axis].creep)
            state->creep = (struct creep_state){{0}};
    }
}

/* Of a model that is prepared. */
static enum wire_status swap_in(struct device *device, struct answer *answer)
{
    enum wire_status status = WIRE_STATUS_OK;
    recall(device);
    device_lock(device);
    if (device->control.state != WIRE_STATE_PARKED) { /* a fault came meanwhile */
        status = WIRE_STATUS_FAULT_LATCHED;
    } else {
        model_store_swap(&device->models);
        device_link_models(device);
        device_begin_idle(device);
        take_memory(device);
    }
    answer->tick = device->control.tick;
    device_unlock(device);
    return status;
}

enum wire_status command_model_commit(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_model_commit_reply reply = {0};
    (void)request;
    enum wire_status status = device_wants_still(device);
    if (status == WIRE_STATUS_OK)
        status = model_store_prepare(&device->models, &reply.invalid_field);
    if (status != WIRE_STATUS_OK) {
        wire_pack_model_commit_reply(&reply, answer->payload, answer->size);
        return status;
    }
    device_make_idle(device, model_store_prepared(&device->models), device->journal.newest.limits);
    reply.held_back = held_back(model_store_prepared(&device->models), device->idle);
    status = check_outputs(device, &reply.invalid_field); /* they stay as they are, unless a fault comes */
    if (status == WIRE_STATUS_OK)
        status = swap_in(device, answer);
    if (status != WIRE_STATUS_OK)
        device_make_idle_again(device);
    wire_pack_model_commit_reply(&reply, answer->payload, answer->size);
    return status;
}

enum wire_status command_model_read(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_model_read_request read;
    const struct model_slot *slot = model_store_active(&device->models);
    wire_unpack_model_read_request(&read, request->payload, request->size);
    if (!slot)
        return WIRE_STATUS_NO_MODEL;
    if (read.offset > WIRE_MODEL_SIZE || read.length > WIRE_MAX_PAYLOAD - WIRE_MODEL_READ_REPLY_SIZE)
        return WIRE_STATUS_BAD_VALUE;
    uint32_t left = WIRE_MODEL_SIZE - read.offset;
    struct wire_model_read_reply reply = {.size = WIRE_MODEL_SIZE,
                                          .crc = slot->crc,
                                          .data = slot->blob + read.offset,
                                          .data_size = read.length < left ? read.length : left};
    answer->size = (size_t)wire_pack_model_read_reply(&reply, answer->payload, WIRE_MAX_PAYLOAD);
    return WIRE_STATUS_OK;
}

enum wire_status command_model_persist(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_model_persist_reply reply = {0};
    (void)request;
    enum wire_status status = device_wants_still(device);
    if (status == WIRE_STATUS_OK)
        status = model_store_persist(&device->models, &device->port.flash, &reply.sequence);
    wire_pack_model_persist_reply(&reply, answer->payload, answer->size);
    device_lock(device);
    answer->tick = device->control.tick;
    if (status == WIRE_STATUS_FLASH_FAILED)
        device_fault(device, WIRE_FAULT_FLASH_ERROR, NO_AXIS, reply.sequence);
    device_unlock(device);
    return status;
}
