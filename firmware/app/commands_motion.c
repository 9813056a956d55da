/* Paths one after another, and where the axes are. */
#include <string.h>

#include "app/command.h"
#include "app/motion.h"
#include "app/path_check.h"
#include "app/points.h"
#include "app/wire_biquad.h"
#include "core/fixed.h"

/* The path that a new one comes after. */
struct tail {
    uint32_t kind; /* enum path_kind */
    struct path_span span;
    struct motion_bounds motion;
    int64_t end; /* where it comes to rest, if it is known */
    bool is_known;
    bool rests;   /* it comes to rest */
    bool is_ring; /* it plays points that come meanwhile, */
    bool is_open; /* not all of which are there */
    uint32_t leave_ticks;
    bool is_over; /* it has */
};

static struct motion_bounds motion_after(const struct device *device, unsigned axis, const struct path_config *path,
                                         const struct path_span *here)
{
    if ((path->flags & PATH_FROM_HERE) == 0 || path->kind != PATH_MOVE)
        return motion_of_path(path, device->wave_steepest_q30[axis]);
    const struct path_span target = {path->swing, path->swing};
    return motion_of_move(span_apart(here, &target), path->step_turn64);
}

/* Where a path comes to rest, of one without an end its offset. False: wherever the path before it is then. */
static bool path_end(const struct path_config *path, int64_t *end)
{
    const bool from_here = (path->flags & PATH_FROM_HERE) != 0;
    *end = path->kind == PATH_MOVE && from_here ? path->swing : path->offset;
    if (path->kind == PATH_MOVE && !from_here)
        *end += path->swing;
    return !from_here || path->kind == PATH_MOVE;
}

/* The tail becomes this path. */
static void follow(const struct device *device, unsigned axis, const struct path_config *path, struct tail *tail)
{
    tail->motion = motion_after(device, axis, path, &tail->span);
    tail->span = path_check_span(path, &tail->span);
    tail->kind = path->kind;
    tail->is_ring = path->kind == PATH_WAVE && points_are_a_ring(device, axis);
    tail->is_open = tail->is_ring && (path->flags & PATH_MORE) != 0;
    tail->rests = !path_is_periodic(path);
    tail->is_over = false;
    tail->is_known = path_end(path, &tail->end);
}

/* Paths under way and queued, as they were at one moment. The ring's places keep what they hold while ticks take them
 * off: only this file fills them. */
struct line_up {
    struct path_config path;
    uint32_t first, count;
    uint32_t is_driven, is_over;
    uint32_t leave_ticks, reserved;
};

static struct line_up line_up_of(const struct device *device, unsigned axis)
{
    const struct axis_state *state = &device->control.axis[axis];
    const struct segment_queue *queue = &device->control.queue[axis];
    return (struct line_up){.path = device->control.config[axis].path,
                            .first = queue->first,
                            .count = queue->count,
                            .is_driven = state->drive == DRIVE_PATH,
                            .leave_ticks = device->control.config[axis].leave_ticks,
                            .is_over = state->path.running == 0 && !join_is_under_way(&state->join)};
}

/* What a path comes after: the last one of the queue or, `at_once`, the one under way. */
static struct tail find_tail(const struct device *device, unsigned axis, const struct line_up *line_up, bool at_once)
{
    const struct segment *ring = device->control.queue[axis].ring;
    struct tail tail = {.span = {line_up->path.offset, line_up->path.offset}};
    follow(device, axis, &line_up->path, &tail);
    tail.is_over = line_up->is_over != 0;
    tail.leave_ticks = line_up->leave_ticks;
    for (unsigned i = 0; i < line_up->count && !at_once; i++) {
        const struct segment *segment = &ring[(line_up->first + i) % SEGMENTS_QUEUED];
        follow(device, axis, &segment->path, &tail);
        tail.leave_ticks = segment->leave_ticks;
    }
    return tail;
}

static struct segment segment_of(const struct wire_segment *asked, const struct wire_queue_request *queue)
{
    return (struct segment){.path = {.kind = asked->path,
                                     .flags = asked->flags,
                                     .swing = asked->swing,
                                     .offset = asked->offset,
                                     .step_turn64 = asked->step_turn64,
                                     .ticks = asked->ticks},
                            .begin_tick = queue->at_once != 0 && queue->begin_tick == 0 ? 1 : queue->begin_tick,
                            .enter_ticks = asked->enter_ticks,
                            .leave_ticks = asked->leave_ticks,
                            .together = queue->axis_mask};
}

/* Without a join a path begins where the one before has come to rest, and at rest. */
static bool continues(struct segment *segment, const struct tail *tail)
{
    struct path_config *path = &segment->path;
    bool beyond = false;
    if (segment->enter_ticks != 0)
        return true;
    if (path_is_periodic(path) || !tail->rests ||
        (segment->begin_tick != 0 && tail->kind == PATH_MOVE && !tail->is_over))
        return false;
    if ((path->flags & PATH_FROM_HERE) == 0)
        return tail->is_known && tail->end == path->offset;
    if (tail->is_known) {
        path->flags &= ~(uint32_t)PATH_FROM_HERE;
        path->offset = sat_i32(tail->end, &beyond);
        if (path->kind == PATH_MOVE)
            path->swing = sat_sub_i32(path->swing, path->offset, &beyond);
    }
    return !beyond;
}

static bool is_slow_enough(const struct device *device, unsigned axis, const struct segment *segment,
                           const struct tail *tail)
{
    const struct motion_bounds *limits = &device->motion_limits[axis], rest = {0, 0, 0};
    struct tail own = *tail;
    follow(device, axis, &segment->path, &own);
    struct motion_bounds joined = own.motion;
    if (segment->enter_ticks != 0)
        joined = motion_of_join(&tail->motion, &own.motion, span_apart(&tail->span, &own.span), segment->enter_turn64);
    if (!motion_is_within(&joined, limits))
        return false;
    joined = own.motion;
    if (segment->leave_ticks != 0)
        joined = motion_of_join(&own.motion, &rest, span_apart(&own.span, &own.span), segment->leave_turn64);
    return motion_is_within(&joined, limits);
}

static enum wire_status check_segment(const struct device *device, unsigned axis, struct segment *segment,
                                      const struct tail *tail)
{
    if (segment->path.kind >= WIRE_PATH_KIND_COUNT || !continues(segment, tail))
        return WIRE_STATUS_BAD_VALUE;
    if (!tail->is_over && tail->is_ring && segment->enter_ticks > tail->leave_ticks)
        return WIRE_STATUS_BAD_VALUE; /* its points suffice for no longer a join */
    if (tail->is_open && !tail->is_over && segment->begin_tick == 0)
        return WIRE_STATUS_WRONG_STATE;
    if (segment->path.kind == PATH_WAVE && device->control.points[axis].ring == POINTS_PLAYED)
        return WIRE_STATUS_BAD_VALUE;
    const enum wire_status status = path_check(device, axis, segment);
    if (status != WIRE_STATUS_OK)
        return status;
    return is_slow_enough(device, axis, segment, tail) ? WIRE_STATUS_OK : WIRE_STATUS_OUTSIDE_LIMITS;
}

static enum wire_status put_segments(struct device *device, const struct wire_queue_request *queue,
                                     const struct segment segments[AXES])
{
    struct control *control = &device->control;
    if (queue->begin_tick != 0 && queue->begin_tick <= control->tick)
        return WIRE_STATUS_BAD_VALUE;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(queue->axis_mask, axis) && queue->at_once == 0 && control->queue[axis].count >= SEGMENTS_QUEUED)
            return WIRE_STATUS_BUSY;
    if (queue->at_once != 0)
        motion_drop(device, queue->axis_mask);
    control->queued++;
    control->first_tick = queue->at_trigger != 0 ? 0 : control->first_tick;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (is_in(queue->axis_mask, axis)) {
            points_set(device, axis, &segments[axis].path);
            segment_put(&control->queue[axis], &segments[axis], control->queued);
        }
    return WIRE_STATUS_OK;
}

/* True: they are no longer as they were. */
static bool line_up_axes(const struct device *device, struct answer *answer, struct line_up line_ups[AXES])
{
    bool differ = false;
    answer->tick = device->control.tick;
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct line_up now = line_up_of(device, axis);
        differ = differ || memcmp(&line_ups[axis], &now, sizeof now) != 0;
        line_ups[axis] = now;
    }
    return differ;
}

static enum wire_status check_segments(const struct device *device, const struct wire_queue_request *queue,
                                       const struct line_up line_ups[AXES], struct segment segments[AXES])
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        if (!is_in(queue->axis_mask, axis))
            continue;
        if (!line_ups[axis].is_driven)
            return WIRE_STATUS_BAD_VALUE;
        segments[axis] = segment_of(&queue->segments[axis], queue);
        const struct tail tail = find_tail(device, axis, &line_ups[axis], queue->at_once != 0);
        const enum wire_status status = check_segment(device, axis, &segments[axis], &tail);
        if (status != WIRE_STATUS_OK)
            return status;
        if (queue->at_trigger != 0)
            segments[axis].path.flags |= PATH_AT_TRIGGER;
    }
    return WIRE_STATUS_OK;
}

/* Checking takes too long to keep ticks out. What they changed meanwhile is checked again, so that the answer is that
 * of one moment, its tick, and a replay finds the same. */
enum wire_status command_queue(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_queue_request queue;
    struct line_up line_ups[AXES];
    struct segment *segments = device->asked;
    enum wire_status status = WIRE_STATUS_OK;
    wire_unpack_queue_request(&queue, request->payload, request->size);
    if (queue.axis_mask == 0 || queue.axis_mask >> AXES != 0 || queue.at_once > 1 || queue.at_trigger > 1)
        return WIRE_STATUS_BAD_VALUE;
    memset(line_ups, 0xff, sizeof line_ups);
    device_lock(device);
    while (status == WIRE_STATUS_OK && line_up_axes(device, answer, line_ups)) {
        device_unlock(device);
        status = check_segments(device, &queue, line_ups, segments);
        device_lock(device);
        if (device->control.state == WIRE_STATE_FAULT) { /* it came meanwhile, and no axis is driven any more */
            answer->tick = device->control.tick;
            status = WIRE_STATUS_FAULT_LATCHED;
        }
    }
    if (status == WIRE_STATUS_OK)
        status = put_segments(device, &queue, segments);
    struct wire_queue_reply reply = {.status = (uint8_t)status};
    for (unsigned axis = 0; axis < AXES; axis++)
        reply.queued[axis] = (uint8_t)device->control.queue[axis].count;
    device_unlock(device);
    wire_pack_queue_reply(&reply, answer->payload, answer->size);
    return status;
}

enum wire_status command_motion(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_motion_request motion;
    (void)answer;
    wire_unpack_motion_request(&motion, request->payload, request->size);
    if (motion.axis >= AXES || motion.window_q16 < 0)
        return WIRE_STATUS_BAD_VALUE;
    device->motion_limits[motion.axis] = (struct motion_bounds){motion.velocity, motion.acceleration, motion.jerk};
    device->control.config[motion.axis].window_q16 = motion.window_q16;
    device->control.config[motion.axis].window_ticks = motion.window_ticks;
    return WIRE_STATUS_OK;
}

enum wire_status command_set_gains(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_set_gains_request set;
    (void)answer;
    wire_unpack_set_gains_request(&set, request->payload, request->size);
    struct loop_filter_config filter;
    if (set.axis >= AXES || set.kp_q24 < 0 || set.ki_ts_q32 < 0 || set.kd_over_ts_q24 < 0 || set.d_alpha_q31 <= 0 ||
        !loop_filter_of(set.filters, &filter))
        return WIRE_STATUS_BAD_VALUE;
    struct axis_config *config = &device->control.config[set.axis];
    const struct pid_config after = {set.kp_q24, set.ki_ts_q32, set.kd_over_ts_q24, set.d_alpha_q31};
    pid_exchange(&config->pid, &after, &device->control.axis[set.axis].pid);
    loop_filter_exchange(&config->filter, &filter, &device->control.axis[set.axis].filter);
    config->pid = after;
    config->filter = filter;
    return WIRE_STATUS_OK;
}

static bool is_moving(const struct device *device, unsigned axis)
{
    const struct axis_state *state = &device->control.axis[axis];
    const struct path_config *path = &device->control.config[axis].path;
    const bool holds = path->kind == PATH_HOLD && path->ticks == 0;
    return state->drive == DRIVE_PATH &&
           (join_is_under_way(&state->join) || state->path.wait_ticks != 0 || device->control.queue[axis].count != 0 ||
            (state->path.running != 0 && !holds));
}

/* Where the last path ends; as long as that is not known, the present reference. */
static int32_t end_of(const struct device *device, unsigned axis)
{
    const struct segment *last = segment_last(&device->control.queue[axis]);
    bool saturated = false;
    int64_t end;
    if (!path_end(last != NULL ? &last->path : &device->control.config[axis].path, &end))
        return device->control.axis[axis].target.reference;
    return sat_i32(end, &saturated);
}

enum wire_status command_where(struct device *device, const struct request *request, struct answer *answer)
{
    const struct control *control = &device->control;
    struct wire_where_reply reply = {.state = (uint8_t)control->state, .fault = (uint8_t)control->fault};
    (void)request;
    for (unsigned axis = 0; axis < AXES; axis++) {
        const uint8_t bit = (uint8_t)(1u << axis);
        reply.driven |= control->axis[axis].drive == DRIVE_PATH ? bit : 0;
        reply.moving |= is_moving(device, axis) ? bit : 0;
        reply.on_target |= axis_is_on_target(&control->config[axis], &control->axis[axis]) ? bit : 0;
        reply.dry |= control->queue[axis].dry != 0 ? bit : 0;
        reply.queued[axis] = (uint8_t)control->queue[axis].count;
        reply.adc_codes[axis] = device->adc_codes[axis];
        reply.u_q24[axis] = control->axis[axis].u_q24;
        reply.reference[axis] = control->axis[axis].target.reference;
        reply.end[axis] = end_of(device, axis);
        reply.near_ticks[axis] = control->axis[axis].near_ticks;
        reply.dry_ticks[axis] = control->queue[axis].dry != 0 ? control->queue[axis].dry_tick : 0;
    }
    wire_pack_where_reply(&reply, answer->payload, answer->size);
    return WIRE_STATUS_OK;
}
