#include "app/motion.h"

/* Axes that would begin the first segment of their queue, were they alone. */
static uint32_t due_axes(const struct device *device)
{
    uint32_t due = 0;
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct axis_state *state = &device->control.axis[axis];
        const struct segment *segment = segment_first(&device->control.queue[axis]);
        if (segment == NULL || state->drive != DRIVE_PATH || join_is_under_way(&state->join) ||
            state->path.wait_ticks != 0)
            continue;
        const bool over = axis_path_is_over(&device->control.config[axis], state);
        if ((segment->path.flags & PATH_AT_TRIGGER) != 0 && !device->trigger_edge)
            continue;
        if (segment->begin_tick != 0 ? device->control.tick >= segment->begin_tick : over)
            due |= 1u << axis;
    }
    return due;
}

/* Whether all axes of a command are at its segment. */
static bool are_together(const struct device *device, uint32_t due, const struct segment *segment)
{
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(segment->together, axis) &&
            (!is_in(due, axis) || segment_first(&device->control.queue[axis])->number != segment->number))
            return false;
    return true;
}

/* How long the paths of these axes wait, so that they begin together. */
static uint32_t longest_wait_ticks(const struct device *device, uint32_t mask)
{
    uint32_t longest = 0;
    for (unsigned axis = 0; axis < AXES; axis++) {
        const uint32_t ticks = axis_wait_ticks(&device->control.config[axis], &device->model_of[axis]);
        longest = is_in(mask, axis) && ticks > longest ? ticks : longest;
    }
    return longest;
}

/* The edge was in the tick before. Periodic paths begin once their joins are over. */
static void tell_of_edge(struct device *device, uint32_t axes, uint32_t wait_ticks)
{
    uint32_t longest = 0;
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct axis_config *config = &device->control.config[axis];
        if (is_in(axes, axis) && path_is_periodic(&config->path) && config->enter_ticks > longest)
            longest = config->enter_ticks;
    }
    device->control.first_tick = device->control.tick + wait_ticks + longest;
    events_put(&device->events, device->control.tick - 1, WIRE_EVENT_KIND_TRIGGER, axes);
}

static void begin_segments(struct device *device, uint32_t due)
{
    uint32_t begin = 0, called = 0;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(due, axis) && are_together(device, due, segment_first(&device->control.queue[axis])))
            begin |= 1u << axis;
    const uint32_t wait_ticks = longest_wait_ticks(device, begin);
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(begin, axis)) {
            struct segment_queue *queue = &device->control.queue[axis];
            const struct segment *segment = segment_first(queue);
            called |= (segment->path.flags & PATH_AT_TRIGGER) != 0 ? 1u << axis : 0;
            axis_begin(&device->control.config[axis], &device->model_of[axis], &device->control.axis[axis], segment,
                       wait_ticks);
            segment_drop_first(queue);
            device->control.path_mask &= ~(1u << axis); /* what was queued is not started a second time */
        }
    if (begin == 0)
        return;
    if (called != 0)
        tell_of_edge(device, called, wait_ticks);
    transient_trigger(&device->transient, WIRE_TRIGGER_SET_POINT, device->control.tick, device->control.config);
}

static void end_path(struct device *device, unsigned axis)
{
    struct axis_config *config = &device->control.config[axis];
    struct axis_state *state = &device->control.axis[axis];
    struct segment_queue *queue = &device->control.queue[axis];
    if (state->drive != DRIVE_PATH || state->path.running != 0 || join_is_under_way(&state->join))
        return;
    if ((config->path.flags & PATH_MORE) != 0 && queue->count == 0) {
        config->path.flags &= ~(uint32_t)PATH_MORE;
        queue->dry = 1;
        queue->dry_tick = device->control.tick;
    }
    axis_leave(config, &device->model_of[axis], state);
}

/* Paths that have ended give way to the next of their queue, or to a hold. */
void motion_move_on(struct device *device)
{
    const uint32_t due = due_axes(device);
    if (due != 0)
        begin_segments(device, due);
    for (unsigned axis = 0; axis < AXES; axis++)
        end_path(device, axis);
}

void motion_drop(struct device *device, uint32_t mask)
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        struct segment_queue *queue = &device->control.queue[axis];
        if (is_in(mask, axis))
            segment_drop_all(queue);
        for (unsigned i = 0; i < SEGMENTS_QUEUED; i++)
            queue->ring[i].together &= ~mask; /* the others need not wait for what will not come */
    }
}
