/* What the device keeps of its own: hard limits and the fault log. */
#include <string.h>

#include "app/command.h"
#include "app/hard_limits.h"
#include "app/reaction.h"

static bool are_sane(const struct wire_axis_limits limits[AXES])
{
    for (unsigned axis = 0; axis < AXES; axis++)
        if (!hard_limits_are_sane(&limits[axis]))
            return false;
    return true;
}

enum wire_status command_limits_set(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_limits_set_request set;
    wire_unpack_limits_set_request(&set, request->payload, request->size);
    if (!are_sane(set.limits))
        return WIRE_STATUS_BAD_VALUE;
    if (device_wants_still(device) != WIRE_STATUS_OK)
        return WIRE_STATUS_BUSY;
    device_make_idle(device, model_store_active(&device->models), set.limits);
    if (!device_admits(device)) { /* the outputs stay as they are, unless a fault comes */
        device_make_idle_again(device);
        return WIRE_STATUS_OUTSIDE_LIMITS;
    }
    bool written = journal_write(&device->journal, &device->port.records, set.limits, NULL);
    device_lock(device);
    answer->tick = device->control.tick;
    if (written)
        device_begin_idle(device);
    else
        device_fault(device, WIRE_FAULT_FLASH_ERROR, NO_AXIS, 0);
    device_unlock(device);
    if (!written)
        device_make_idle_again(device);
    return written ? WIRE_STATUS_OK : WIRE_STATUS_FLASH_FAILED;
}

enum wire_status command_limits_read(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_limits_read_reply reply = {.limits_lost = device->journal.newest.limits_lost};
    (void)request;
    memcpy(reply.limits, device->journal.newest.limits, sizeof reply.limits);
    wire_pack_limits_read_reply(&reply, answer->payload, answer->size);
    return WIRE_STATUS_OK;
}

enum wire_status command_fault_log(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_fault_log_reply reply = {.power_cycle = device->journal.newest.power_cycle};
    (void)request;
    reply.count = (uint8_t)fault_log_read(device->port.fault_log, &device->journal, reply.faults);
    wire_pack_fault_log_reply(&reply, answer->payload, answer->size);
    return WIRE_STATUS_OK;
}
