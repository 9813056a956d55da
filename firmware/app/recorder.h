/* The recorder: a ring of batches, filled tick by tick and drained frame by frame as fast as the line takes them.
 *
 * A batch holds consecutive ticks only. When no batch is free ticks are dropped and counted, and the next batch says
 * how many. Filled in the tick, emptied outside it: one producer, one consumer.
 */
#ifndef PHASELEAD_APP_RECORDER_H
#define PHASELEAD_APP_RECORDER_H

#include <stdatomic.h>

#include "app/wire.h"
#include "core/axis.h"

#define RECORDER_AXES 3
#define RECORDER_BATCHES 25
#define RECORDER_DATA_SIZE (WIRE_MAX_PAYLOAD - WIRE_SAMPLES_SIZE)
#define RECORDER_POST_TRIGGER_TICKS 250 /* 50 ms: enough to see how the output reacted to a fault */

struct recorder_batch {
    uint64_t first_tick;
    uint32_t dropped; /* before this batch */
    uint32_t size;    /* of the data */
    /* A whole frame body, so that it is sealed where it lies: header, payload, CRC. */
    uint8_t body[WIRE_MAX_BODY + 1];
};

struct recorder_format {
    uint8_t channels, axis_mask; /* of the wire */
    uint16_t decimation;
    uint32_t tick_size;  /* bytes a tick */
    uint32_t batch_size; /* bytes of data in a full batch */
};

struct recorder {
    struct recorder_format format;
    bool recording;
    bool dropping;        /* since the last batch */
    uint16_t skip;        /* ticks to pass before the next one is taken */
    uint32_t freeze_left; /* 0: not frozen; else ticks until it stops, plus one */
    uint32_t sequence;    /* of the next batch to be sent */
    uint64_t released;    /* bytes of data that were sent */
    uint64_t dropped;
    struct recorder_batch *open;   /* being filled, or NULL */
    struct recorder_batch *next;   /* to be filled: a pointer, so that a tick does not divide by their number */
    struct recorder_batch *oldest; /* to be sent */
    _Atomic uint32_t filled, drained;
    struct recorder_batch batches[RECORDER_BATCHES];
};

/* False when channels, axes or decimation are not valid. */
bool recorder_format(struct recorder_format *format, uint8_t channels, uint8_t axis_mask, uint16_t decimation);

/* Bytes a second that it takes on the line, frames and all. */
uint32_t recorder_bytes_per_s(const struct recorder_format *format);

/* Empties the ring and records from the next tick on. */
void recorder_start(struct recorder *recorder, const struct recorder_format *format);

/* What is buffered can still be sent. */
void recorder_stop(struct recorder *recorder);

/* Stops RECORDER_POST_TRIGGER_TICKS later; from then on nothing is recorded, and nothing counts as dropped. */
void recorder_freeze(struct recorder *recorder);

/* Empties the ring too. */
void recorder_discard(struct recorder *recorder);

/* Records a tick; both arrays have RECORDER_AXES elements. `trigger`: the channel of that name, for all axes. True when
 * it was dropped for want of a free batch, and is the first of a row of such. */
bool recorder_tick(struct recorder *recorder, uint64_t tick, const uint16_t *adc_codes, const struct axis_trace *traces,
                   uint8_t trigger);

/* Ticks taken since it was started, without those in a batch that is still open. Not for the tick. */
uint64_t recorder_taken(struct recorder *recorder);

/* These ticks passed without recorder_tick(): they count as dropped. */
void recorder_miss(struct recorder *recorder, uint32_t ticks);

/* The oldest full batch, its payload complete but for header and CRC; NULL when there is none. */
struct recorder_batch *recorder_next(struct recorder *recorder, size_t *payload_size);

/* It has been sealed elsewhere and may be filled again. */
void recorder_release(struct recorder *recorder);

#endif
