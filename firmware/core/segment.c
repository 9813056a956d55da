#include "core/segment.h"

#include <stddef.h>

#define RING_MASK (SEGMENTS_QUEUED - 1u)
_Static_assert((SEGMENTS_QUEUED & RING_MASK) == 0, "the ring wraps by a mask");

void segment_put(struct segment_queue *queue, const struct segment *segment, uint32_t number)
{
    if (queue->count >= SEGMENTS_QUEUED)
        return;
    struct segment *place = &queue->ring[(queue->first + queue->count) & RING_MASK];
    *place = *segment;
    place->number = number;
    queue->count++;
    queue->dry = 0;
}

const struct segment *segment_first(const struct segment_queue *queue)
{
    return queue->count != 0 ? &queue->ring[queue->first & RING_MASK] : NULL;
}

const struct segment *segment_last(const struct segment_queue *queue)
{
    return queue->count != 0 ? &queue->ring[(queue->first + queue->count - 1) & RING_MASK] : NULL;
}

void segment_drop_first(struct segment_queue *queue)
{
    if (queue->count == 0)
        return;
    queue->first = (queue->first + 1) & RING_MASK;
    queue->count--;
}

void segment_drop_all(struct segment_queue *queue)
{
    queue->count = 0;
}

void segment_reset(struct segment_queue *queue)
{
    queue->dry_tick = 0;
    queue->first = queue->count = queue->dry = 0;
}

bool join_is_under_way(const struct join_state *join)
{
    return join->step_turn64 != 0;
}

uint32_t join_weight_q30(const struct join_state *join, uint32_t ticks_q16)
{
    const uint64_t wait_q16 = (uint64_t)join->wait_ticks << 16;
    const uint32_t left_q16 = wait_q16 < ticks_q16 ? (uint32_t)(ticks_q16 - wait_q16) : 0;
    return path_least_jerk_q30(path_phase_ahead(join->phase_turn64, join->step_turn64, left_q16));
}

void join_advance(struct join_state *join)
{
    if (join->standing == 0)
        path_run_on(&join->path, &join->state);
    if (join->wait_ticks != 0) {
        join->wait_ticks--;
        return;
    }
    join->phase_turn64 = path_phase_ahead(join->phase_turn64, join->step_turn64, 1u << 16);
    if (join->phase_turn64 == UINT64_MAX)
        join->step_turn64 = 0;
}
