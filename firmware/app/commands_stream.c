/* The recorder's stream, and what a replay starts from. */
#include <string.h>

#include "app/command.h"

#define LATCH_TRIES 4
#define FAULTS_PACKED_SIZE (sizeof(uint32_t) + JOURNAL_FAULTS * WIRE_LOGGED_FAULT_SIZE)

static uint64_t next_tick(const struct device *device)
{
    device_lock(device);
    const uint64_t tick = device->control.tick;
    device_unlock(device);
    return tick;
}

/* The control state of the tick from which the stream begins. It is copied while ticks go on, and again if one came
 * in between. False: one came in between each time. */
static bool latch(struct device *device, const struct recorder_format *format, struct answer *answer)
{
    bool whole = false;
    device->latched_valid = false;
    for (unsigned i = 0; i < LATCH_TRIES && !whole; i++) {
        answer->tick = next_tick(device);
        memcpy(&device->latched, &device->control, sizeof device->latched);
        device_lock(device);
        whole = device->control.tick == answer->tick;
        if (whole)
            recorder_start(&device->recorder, format);
        device_unlock(device);
    }
    device->latched_valid = whole;
    return whole;
}

enum wire_status command_stream_start(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_stream_start_request start;
    struct recorder_format format;
    wire_unpack_stream_start_request(&start, request->payload, request->size);
    if (!recorder_format(&format, start.channels, start.axis_mask, start.decimation))
        return WIRE_STATUS_BAD_VALUE;
    struct wire_stream_start_reply reply = {.bytes_per_s = recorder_bytes_per_s(&format),
                                            .budget_bytes_per_s = line_budget_bytes_per_s(device->port.baud),
                                            .state_size = sizeof device->latched};
    wire_pack_stream_start_reply(&reply, answer->payload, answer->size);
    if (reply.bytes_per_s > reply.budget_bytes_per_s)
        return WIRE_STATUS_BAUD_BUDGET;
    return latch(device, &format, answer) ? WIRE_STATUS_OK : WIRE_STATUS_BUSY;
}

enum wire_status command_stream_stop(struct device *device, const struct request *request, struct answer *answer)
{
    (void)request;
    recorder_stop(&device->recorder);
    struct wire_stream_stop_reply reply = {.sent_ticks = recorder_taken(&device->recorder),
                                           .dropped_ticks = device->recorder.dropped};
    wire_pack_stream_stop_reply(&reply, answer->payload, answer->size);
    return WIRE_STATUS_OK;
}

static uint32_t pack_faults(struct device *device, uint8_t out[FAULTS_PACKED_SIZE])
{
    struct wire_logged_fault faults[JOURNAL_FAULTS];
    device_lock(device);
    uint32_t count = fault_log_read(device->port.fault_log, &device->journal, faults);
    device_unlock(device);
    const uint32_t power_cycle = device->journal.newest.power_cycle;
    uint32_t size = sizeof power_cycle;
    memcpy(out, &power_cycle, sizeof power_cycle);
    for (; count > 0; count--, size += WIRE_LOGGED_FAULT_SIZE)
        wire_pack_logged_fault(&faults[count - 1], out + size, WIRE_LOGGED_FAULT_SIZE);
    return size;
}

enum wire_status command_snapshot_read(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_snapshot_read_request read;
    struct wire_snapshot_read_reply reply = {0};
    wire_unpack_snapshot_read_request(&read, request->payload, request->size);
    const uint8_t *from = (const uint8_t *)&device->latched;
    uint8_t faults[FAULTS_PACKED_SIZE];
    if (read.region >= WIRE_REGION_COUNT)
        return WIRE_STATUS_BAD_VALUE;
    if (read.region == WIRE_REGION_STATE) {
        reply.size = device->latched_valid ? sizeof device->latched : 0;
    } else if (read.region == WIRE_REGION_FAULTS) {
        from = faults;
        reply.size = pack_faults(device, faults);
    } else {
        unsigned axis = read.region - WIRE_REGION_WAVE_X;
        from = (const uint8_t *)device->waves_q30[axis];
        reply.size = is_in(device->wave_mask, axis) ? sizeof device->waves_q30[axis] : 0;
    }
    if (read.offset > reply.size || read.length > WIRE_MAX_PAYLOAD - WIRE_SNAPSHOT_READ_REPLY_SIZE)
        return WIRE_STATUS_BAD_VALUE;
    uint32_t left = reply.size - read.offset;
    reply.data = from + read.offset;
    reply.data_size = read.length < left ? read.length : left;
    answer->size = (size_t)wire_pack_snapshot_read_reply(&reply, answer->payload, WIRE_MAX_PAYLOAD);
    return WIRE_STATUS_OK;
}
