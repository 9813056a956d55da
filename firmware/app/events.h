/* Events waiting to be sent. Numbered as they happen, so that a lost one leaves a hole in the numbers. */
#ifndef PHASELEAD_APP_EVENTS_H
#define PHASELEAD_APP_EVENTS_H

#include <stdatomic.h>

#include "app/wire.h"

#define EVENTS_HELD 16

struct events {
    struct wire_event ring[EVENTS_HELD];
    uint16_t ids[EVENTS_HELD];
    uint16_t next_id;
    _Atomic uint32_t put, taken;
};

void events_put(struct events *events, uint64_t tick, enum wire_event_kind kind, uint32_t value);

/* False when there is none. */
bool events_take(struct events *events, struct wire_event *event, uint16_t *id);

#endif
