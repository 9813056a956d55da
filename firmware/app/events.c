#include "app/events.h"

void events_put(struct events *events, uint64_t tick, enum wire_event_kind kind, uint32_t value)
{
    uint32_t put = atomic_load_explicit(&events->put, memory_order_relaxed);
    uint16_t id = events->next_id++;
    if (put - atomic_load_explicit(&events->taken, memory_order_acquire) >= EVENTS_HELD)
        return;
    events->ring[put % EVENTS_HELD] = (struct wire_event){.tick = tick, .kind = (uint8_t)kind, .value = value};
    events->ids[put % EVENTS_HELD] = id;
    atomic_store_explicit(&events->put, put + 1, memory_order_release);
}

bool events_take(struct events *events, struct wire_event *event, uint16_t *id)
{
    uint32_t taken = atomic_load_explicit(&events->taken, memory_order_relaxed);
    if (atomic_load_explicit(&events->put, memory_order_acquire) == taken)
        return false;
    *event = events->ring[taken % EVENTS_HELD];
    *id = events->ids[taken % EVENTS_HELD];
    atomic_store_explicit(&events->taken, taken + 1, memory_order_release);
    return true;
}
