/* Points of a path that is played while they come. */
#include <string.h>

#include "app/command.h"
#include "app/points.h"
#include "core/fixed.h"

#define ONE_Q30 (1 << 30)

enum wire_status command_points_begin(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_points_begin_request asked;
    enum wire_status status = WIRE_STATUS_OK;
    wire_unpack_points_begin_request(&asked, request->payload, request->size);
    if (asked.axis_mask == 0 || asked.axis_mask >> AXES != 0 || asked.ticks_log2 > POINTS_LOG2_MOST ||
        asked.first > 0 || asked.first < -WAVE_POINTS)
        return WIRE_STATUS_BAD_VALUE;
    const struct points_ring ring = {
        .ring = POINTS_RING, .ticks_log2 = asked.ticks_log2, .first = asked.first, .next = asked.first};
    device_lock(device);
    answer->tick = device->control.tick;
    if ((asked.axis_mask & points_waves_used(device)) != 0)
        status = WIRE_STATUS_BUSY;
    else
        points_begin(device, asked.axis_mask, &ring, asked.steepest_q30);
    device_unlock(device);
    return status;
}

static int32_t point_at(const uint8_t *data, size_t index)
{
    int32_t point;
    memcpy(&point, data + index * sizeof point, sizeof point);
    return point;
}

struct arrival {
    const uint8_t *data;
    uint32_t mask, count; /* of each axis */
    int32_t first;
};

/* Where the points of an axis begin. */
static const uint8_t *data_of(const struct arrival *arrival, unsigned axis)
{
    const uint32_t before = arrival->mask & ((1u << axis) - 1);
    const uint32_t axes_before = (before & 1u) + (before >> 1 & 1u);
    return arrival->data + (size_t)axes_before * arrival->count * sizeof(int32_t);
}

/* Points of an axis are values, and none is further from the one before than was said. */
static bool are_steady(const struct device *device, unsigned axis, const struct arrival *arrival)
{
    const struct points_ring *ring = &device->control.points[axis];
    const uint8_t *data = data_of(arrival, axis);
    const bool begins = ring->next == ring->first;
    int32_t before = begins ? point_at(data, 0) : device->waves_q30[axis][(uint32_t)(ring->next - 1) % WAVE_POINTS];
    for (uint32_t i = 0; i < arrival->count; i++) {
        const int32_t point = point_at(data, i);
        if (point < 0 || point > ONE_Q30 || magnitude_i64((int64_t)point - before) > ring->steepest_q30)
            return false;
        before = point;
    }
    return true;
}

/* A path that was begun may have ended meanwhile. */
static bool is_lost(struct device *device, unsigned axis)
{
    return device->control.points[axis].ring == POINTS_PLAYED && points_path(device, axis) == NULL;
}

/* Nobody but commands changes what this asks, besides the room, which only grows, and the path, which may end: then
 * there is never more room. */
static enum wire_status check(struct device *device, const struct arrival *arrival)
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct points_ring *ring = &device->control.points[axis];
        if (!is_in(arrival->mask, axis))
            continue;
        if (!points_are_a_ring(device, axis) || ring->next != arrival->first || !are_steady(device, axis, arrival))
            return WIRE_STATUS_BAD_VALUE;
        device_lock(device);
        const uint32_t room = points_room(device, axis);
        const bool lost = is_lost(device, axis);
        device_unlock(device);
        if (arrival->count > room)
            return lost ? WIRE_STATUS_WRONG_STATE : WIRE_STATUS_BUSY;
    }
    return WIRE_STATUS_OK;
}

/* Behind what a tick looks at: a path never is longer than the points that are known of. */
static void put_down(struct device *device, const struct arrival *arrival)
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        if (!is_in(arrival->mask, axis))
            continue;
        const uint8_t *data = data_of(arrival, axis);
        for (uint32_t i = 0; i < arrival->count; i++)
            device->waves_q30[axis][((uint32_t)arrival->first + i) % WAVE_POINTS] = point_at(data, i);
    }
}

static enum wire_status take_up(struct device *device, const struct arrival *arrival, uint64_t length_ticks,
                                struct answer *answer)
{
    enum wire_status status = WIRE_STATUS_OK;
    device_lock(device);
    answer->tick = device->control.tick;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(arrival->mask, axis) && is_lost(device, axis))
            status = WIRE_STATUS_WRONG_STATE;
    for (unsigned axis = 0; axis < AXES && status == WIRE_STATUS_OK; axis++)
        if (is_in(arrival->mask, axis))
            points_come(device, axis, arrival->count, length_ticks);
    device_unlock(device);
    return status;
}

static struct wire_points_reply standing(struct device *device, uint32_t mask)
{
    struct wire_points_reply reply = {.room = WAVE_POINTS};
    device_lock(device);
    for (unsigned axis = 0; axis < AXES; axis++) {
        if (!is_in(mask, axis) || !points_are_a_ring(device, axis))
            continue;
        const uint32_t room = points_room(device, axis);
        const uint64_t left = points_left_ticks(device, axis);
        reply.room = room < reply.room ? (uint16_t)room : reply.room;
        reply.left_ticks = left < UINT32_MAX ? (uint32_t)left : UINT32_MAX;
    }
    device_unlock(device);
    return reply;
}

enum wire_status command_points(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_points_request asked;
    wire_unpack_points_request(&asked, request->payload, request->size);
    const uint32_t axes = (asked.axis_mask & 1u) + (asked.axis_mask >> 1 & 1u) + (asked.axis_mask >> 2 & 1u);
    if (axes == 0 || asked.axis_mask >> AXES != 0 || asked.data_size % (axes * sizeof(int32_t)) != 0)
        return WIRE_STATUS_BAD_VALUE;
    const struct arrival arrival = {.data = asked.data,
                                    .mask = asked.axis_mask,
                                    .count = (uint32_t)(asked.data_size / (axes * sizeof(int32_t))),
                                    .first = asked.first};
    enum wire_status status = check(device, &arrival);
    if (status == WIRE_STATUS_OK) {
        put_down(device, &arrival);
        status = take_up(device, &arrival, asked.length_ticks, answer);
    }
    const struct wire_points_reply reply = standing(device, arrival.mask);
    wire_pack_points_reply(&reply, answer->payload, answer->size);
    return status;
}
