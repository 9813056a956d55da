#include "app/recorder.h"

#include <string.h>

#include "app/frame.h"
#include "core/fixed.h"

#define BATCH_LATENCY_TICKS 500 /* a slow stream is sent at least ten times a second */
#define ALL_CHANNELS ((1u << WIRE_CHANNEL_COUNT) - 1)
#define ALL_AXES ((1u << RECORDER_AXES) - 1)
#define Q24_TO_Q11 13

bool recorder_format(struct recorder_format *format, uint8_t channels, uint8_t axis_mask, uint16_t decimation)
{
    if (channels == 0 || channels > ALL_CHANNELS || axis_mask == 0 || axis_mask > ALL_AXES || decimation == 0)
        return false;
    uint32_t axes = (axis_mask & 1u) + (axis_mask >> 1 & 1u) + (axis_mask >> 2 & 1u);
    uint32_t tick_size = axes * (uint32_t)wire_tick_size(channels);
    uint32_t fit = RECORDER_DATA_SIZE / tick_size;
    uint32_t soon = BATCH_LATENCY_TICKS / decimation;
    uint32_t ticks = soon < 1 ? 1 : soon < fit ? soon : fit;
    *format = (struct recorder_format){channels, axis_mask, decimation, tick_size, ticks * tick_size};
    return true;
}

uint32_t recorder_bytes_per_s(const struct recorder_format *format)
{
    uint32_t frame = COBS_ENCODED_MAX(WIRE_HEADER_SIZE + WIRE_SAMPLES_SIZE + format->batch_size + WIRE_CRC_SIZE) + 1;
    uint32_t ticks = format->batch_size / format->tick_size * format->decimation;
    return (frame * TICK_RATE_HZ + ticks - 1) / ticks;
}

void recorder_start(struct recorder *recorder, const struct recorder_format *format)
{
    recorder_discard(recorder);
    recorder->format = *format;
    recorder->skip = 0;
    recorder->freeze_left = 0;
    recorder->sequence = 0;
    recorder->released = 0;
    recorder->dropped = 0;
    recorder->dropping = false;
    recorder->recording = true;
}

static struct recorder_batch *batch_after(struct recorder *recorder, struct recorder_batch *batch)
{
    return batch == &recorder->batches[RECORDER_BATCHES - 1] ? recorder->batches : batch + 1;
}

static void close_batch(struct recorder *recorder)
{
    if (!recorder->open)
        return;
    recorder->next = batch_after(recorder, recorder->open);
    recorder->open = NULL;
    uint32_t filled = atomic_load_explicit(&recorder->filled, memory_order_relaxed); /* nobody else writes it */
    atomic_store_explicit(&recorder->filled, filled + 1, memory_order_release);
}

void recorder_stop(struct recorder *recorder)
{
    recorder->recording = false;
    close_batch(recorder);
}

void recorder_freeze(struct recorder *recorder)
{
    if (recorder->freeze_left == 0)
        recorder->freeze_left = RECORDER_POST_TRIGGER_TICKS + 1;
}

void recorder_discard(struct recorder *recorder)
{
    recorder_stop(recorder);
    atomic_store_explicit(&recorder->drained, atomic_load_explicit(&recorder->filled, memory_order_relaxed),
                          memory_order_release);
    recorder->next = recorder->oldest = recorder->batches;
}

static bool open_batch(struct recorder *recorder, uint64_t tick)
{
    uint32_t filled = atomic_load_explicit(&recorder->filled, memory_order_relaxed);
    if (filled - atomic_load_explicit(&recorder->drained, memory_order_acquire) >= RECORDER_BATCHES)
        return false;
    struct recorder_batch *batch = recorder->next;
    batch->first_tick = tick;
    batch->dropped = (uint32_t)recorder->dropped;
    batch->size = 0;
    recorder->open = batch;
    recorder->dropping = false;
    return true;
}

static int16_t volts_q11(int32_t u_q24)
{
    return sat_i16(round_shift_i32(u_q24, Q24_TO_Q11));
}

static uint8_t *put_axis(uint8_t *to, uint8_t channels, uint16_t adc_code, const struct axis_trace *trace,
                         uint8_t trigger)
{
    const struct wire_tick tick = {
        trace->reference, adc_code, trace->dac_code, volts_q11(trace->feedforward_q24), volts_q11(trace->feedback_q24),
        trigger};
    return wire_put_tick(to, channels, &tick);
}

static void put_traces(const struct recorder_format *format, struct recorder_batch *batch, const uint16_t *adc_codes,
                       const struct axis_trace *traces, uint8_t trigger)
{
    uint8_t *to = batch->body + WIRE_HEADER_SIZE + WIRE_SAMPLES_SIZE + batch->size;
    for (unsigned i = 0; i < RECORDER_AXES; i++)
        if ((format->axis_mask >> i & 1u) != 0)
            to = put_axis(to, format->channels, adc_codes[i], &traces[i], trigger);
    batch->size += format->tick_size;
}

bool recorder_tick(struct recorder *recorder, uint64_t tick, const uint16_t *adc_codes, const struct axis_trace *traces,
                   uint8_t trigger)
{
    if (recorder->recording && recorder->freeze_left != 0) {
        recorder->freeze_left--;
        if (recorder->freeze_left == 0)
            recorder_stop(recorder);
    }
    if (!recorder->recording)
        return false;
    if (recorder->skip > 0) {
        recorder->skip--;
        return false;
    }
    recorder->skip = (uint16_t)(recorder->format.decimation - 1);
    if (!recorder->open && !open_batch(recorder, tick)) {
        const bool first = !recorder->dropping;
        recorder->dropping = true;
        recorder->dropped++;
        return first;
    }
    put_traces(&recorder->format, recorder->open, adc_codes, traces, trigger);
    if (recorder->open->size == recorder->format.batch_size)
        close_batch(recorder);
    return false;
}

uint64_t recorder_taken(struct recorder *recorder)
{
    uint64_t bytes = recorder->released;
    uint32_t waiting = atomic_load_explicit(&recorder->filled, memory_order_acquire) -
                       atomic_load_explicit(&recorder->drained, memory_order_relaxed);
    struct recorder_batch *batch = recorder->oldest;
    for (uint32_t i = 0; i < waiting; i++) {
        bytes += batch->size;
        batch = batch_after(recorder, batch);
    }
    return bytes == 0 ? 0 : bytes / recorder->format.tick_size;
}

void recorder_miss(struct recorder *recorder, uint32_t ticks)
{
    uint32_t decimation = recorder->format.decimation;
    if (!recorder->recording || ticks == 0)
        return;
    uint32_t rows = ticks > recorder->skip ? (ticks - recorder->skip - 1) / decimation + 1 : 0;
    recorder->skip = (uint16_t)(recorder->skip + rows * decimation - ticks);
    if (rows > 0)
        close_batch(recorder);
    recorder->dropped += rows;
}

struct recorder_batch *recorder_next(struct recorder *recorder, size_t *payload_size)
{
    uint32_t drained = atomic_load_explicit(&recorder->drained, memory_order_relaxed);
    if (atomic_load_explicit(&recorder->filled, memory_order_acquire) == drained)
        return NULL;
    struct recorder_batch *batch = recorder->oldest;
    const struct recorder_format *format = &recorder->format;
    struct wire_samples head = {.sequence = recorder->sequence,
                                .first_tick = batch->first_tick,
                                .dropped = batch->dropped,
                                .channels = format->channels,
                                .axis_mask = format->axis_mask,
                                .decimation = format->decimation};
    wire_pack_samples(&head, batch->body + WIRE_HEADER_SIZE, WIRE_SAMPLES_SIZE);
    *payload_size = WIRE_SAMPLES_SIZE + batch->size;
    return batch;
}

void recorder_release(struct recorder *recorder)
{
    recorder->sequence++;
    recorder->released += recorder->oldest->size;
    recorder->oldest = batch_after(recorder, recorder->oldest);
    atomic_fetch_add_explicit(&recorder->drained, 1, memory_order_release);
}
