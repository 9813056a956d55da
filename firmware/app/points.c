#include "app/points.h"

#include <string.h>

#include "core/fixed.h"

#define ONE_POINT_TURN64 ((uint64_t)1 << 54) /* 1024 points a turn */

static bool wave_is_used(const struct device *device, unsigned axis)
{
    const struct control *control = &device->control;
    const struct join_state *join = &control->axis[axis].join;
    const struct segment_queue *queue = &control->queue[axis];
    if (control->axis[axis].drive != DRIVE_PATH)
        return false;
    bool used = control->config[axis].path.kind == PATH_WAVE;
    used = used || (join_is_under_way(join) && join->standing == 0 && join->path.kind == PATH_WAVE);
    for (unsigned i = 0; i < queue->count; i++)
        used = used || queue->ring[(queue->first + i) % SEGMENTS_QUEUED].path.kind == PATH_WAVE;
    return used;
}

uint32_t points_waves_used(const struct device *device)
{
    uint32_t used = 0;
#pragma GCC unroll 1 /* the flash is short of room */
    for (unsigned axis = 0; axis < AXES; axis++)
        used |= wave_is_used(device, axis) ? 1u << axis : 0;
    return used;
}

static void begin(struct device *device, unsigned axis, const struct points_ring *ring, uint32_t steepest_q30)
{
    struct control *control = &device->control;
    struct path_config *path = &control->config[axis].path;
    control->points[axis] = *ring;
    control->points[axis].steepest_q30 = steepest_q30;
    control->queue[axis].dry = 0;
    device->wave_steepest_q30[axis] = steepest_q30;
    device->wave_for[axis] = (struct learned_for){0, 0};
    device->wave_mask |= 1u << axis;
    if (path->kind == PATH_WAVE) { /* what it was to play is gone */
        memset(path, 0, sizeof *path);
        control->path_mask &= ~(1u << axis);
    }
}

void points_begin(struct device *device, uint32_t mask, const struct points_ring *ring,
                  const uint32_t steepest_q30[AXES])
{
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(mask, axis))
            begin(device, axis, ring, steepest_q30[axis]);
    device_link_models(device);
}

/* Beyond the end of a path: the join that leaves it waits for the longest look ahead of all axes, whatever their modes,
 * and looks ahead itself. */
static uint64_t margin_ticks(const struct device *device, uint32_t leave_ticks)
{
    uint32_t longest_q16 = 0;
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct compensation *compensation = device->model_of[axis].compensation;
        if (compensation != NULL && compensation->preview_ticks_q16 > longest_q16)
            longest_q16 = compensation->preview_ticks_q16;
    }
    return (uint64_t)leave_ticks + 2 * ((longest_q16 >> 16) + 1) + 2;
}

/* The longest that a path may be by the points that are there: a value lies between two of them. 0: there is no such
 * path. */
static uint64_t sufficient_ticks(const struct device *device, unsigned axis, uint32_t leave_ticks)
{
    const struct points_ring *ring = &device->control.points[axis];
    const uint64_t margin = margin_ticks(device, leave_ticks);
    const uint64_t there = ring->next < 2 ? 0 : (uint64_t)(ring->next - 2) << ring->ticks_log2;
    return there > margin ? there - margin : 0;
}

/* False: it would end at once. */
static bool set_length(const struct device *device, unsigned axis, struct path_config *path, uint32_t leave_ticks)
{
    const uint64_t length = device->control.points[axis].length_ticks;
    const uint64_t sufficient = sufficient_ticks(device, axis, leave_ticks);
    const bool is_whole = length != 0 && length <= sufficient;
    path->ticks = is_whole ? length : sufficient;
    path->flags = is_whole ? path->flags & ~(uint32_t)PATH_MORE : path->flags | PATH_MORE;
    return path->ticks != 0;
}

enum wire_status points_fit(const struct device *device, unsigned axis, struct segment *segment)
{
    const struct points_ring *ring = &device->control.points[axis];
    const int64_t before = ((int64_t)segment->enter_ticks + (1 << ring->ticks_log2) - 1) >> ring->ticks_log2;
    if (axis_mode_uses_tables(device->control.config[axis].mode))
        return WIRE_STATUS_MODE_UNSUPPORTED; /* it has neither swing nor frequency to look up */
    if (segment->path.step_turn64 != ONE_POINT_TURN64 >> ring->ticks_log2 || ring->first > -before)
        return WIRE_STATUS_BAD_VALUE;
    return set_length(device, axis, &segment->path, segment->leave_ticks) ? WIRE_STATUS_OK : WIRE_STATUS_BAD_VALUE;
}

void points_set(struct device *device, unsigned axis, const struct path_config *path)
{
    if (path->kind == PATH_WAVE && points_are_a_ring(device, axis))
        device->control.points[axis].ring = POINTS_PLAYED;
}

static struct segment *queued_path(struct device *device, unsigned axis)
{
    struct segment_queue *queue = &device->control.queue[axis];
    for (unsigned i = 0; i < queue->count; i++) {
        struct segment *segment = &queue->ring[(queue->first + i) % SEGMENTS_QUEUED];
        if (segment->path.kind == PATH_WAVE)
            return segment;
    }
    return NULL;
}

/* It is set and not started, or started and not ended. */
static bool is_set_or_played(const struct device *device, unsigned axis)
{
    const struct axis_state *state = &device->control.axis[axis];
    const bool driven = state->drive == DRIVE_PATH;
    return device->control.config[axis].path.kind == PATH_WAVE &&
           (driven ? state->path.running != 0 : is_in(device->control.path_mask, axis));
}

struct path_config *points_path(struct device *device, unsigned axis)
{
    struct segment *queued = queued_path(device, axis);
    if (queued != NULL)
        return &queued->path;
    return is_set_or_played(device, axis) ? &device->control.config[axis].path : NULL;
}

static bool is_played(const struct device *device, unsigned axis)
{
    return device->control.axis[axis].drive == DRIVE_PATH && is_set_or_played(device, axis);
}

uint64_t points_left_ticks(const struct device *device, unsigned axis)
{
    const struct control *control = &device->control;
    return is_played(device, axis) ? control->config[axis].path.ticks - control->axis[axis].path.elapsed : 0;
}

uint32_t points_room(struct device *device, unsigned axis)
{
    const struct points_ring *ring = &device->control.points[axis];
    const uint64_t elapsed = is_played(device, axis) ? device->control.axis[axis].path.elapsed : 0;
    const int32_t oldest = elapsed != 0 ? (int32_t)(elapsed >> ring->ticks_log2) : ring->first;
    return (uint32_t)(WAVE_POINTS - (ring->next - oldest));
}

void points_come(struct device *device, unsigned axis, uint32_t count, uint64_t length_ticks)
{
    struct points_ring *ring = &device->control.points[axis];
    const struct segment *queued = queued_path(device, axis);
    struct path_config *path = points_path(device, axis);
    ring->next += (int32_t)count;
    ring->length_ticks = length_ticks;
    if (path != NULL)
        set_length(device, axis, path, queued != NULL ? queued->leave_ticks : device->control.config[axis].leave_ticks);
}
