/* The transient recorder's trigger, and what it froze. */
#include <string.h>

#include "app/command.h"

enum wire_status command_transient_arm(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_transient_arm_request arm;
    wire_unpack_transient_arm_request(&arm, request->payload, request->size);
    struct wire_transient_arm_reply reply = {.entries = TRANSIENT_ENTRIES};
    wire_pack_transient_arm_reply(&reply, answer->payload, answer->size);
    return transient_arm(&device->transient, &arm) ? WIRE_STATUS_OK : WIRE_STATUS_BAD_VALUE;
}

enum wire_status command_transient_read(struct device *device, const struct request *request, struct answer *answer)
{
    const struct transient *transient = &device->transient;
    struct wire_transient_read_request read;
    wire_unpack_transient_read_request(&read, request->payload, request->size);
    struct wire_transient_read_reply reply = {.state = transient->state,
                                              .cause = transient->cause,
                                              .trigger_tick = transient->trigger_tick,
                                              .decimation = transient->trigger.decimation};
    memcpy(reply.modes, transient->modes, sizeof reply.modes);
    if (transient->state == WIRE_TRANSIENT_STATE_FROZEN) { /* before, it still changes */
        reply.size = transient->count * (uint32_t)sizeof transient->entries[0];
        reply.data_size = read.length;
        if (read.length > WIRE_MAX_PAYLOAD - WIRE_TRANSIENT_READ_REPLY_SIZE)
            return WIRE_STATUS_BAD_VALUE;
        reply.data = transient_bytes(transient, read.offset, &reply.data_size);
        if (reply.data == NULL)
            return WIRE_STATUS_BAD_VALUE;
    }
    answer->size = (size_t)wire_pack_transient_read_reply(&reply, answer->payload, WIRE_MAX_PAYLOAD);
    return WIRE_STATUS_OK;
}
