#include "day.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "app/cobs.h"
#include "app/device_init.h"
#include "app/device_tick.h"
#include "app/fault_writing.h"
#include "app/frame.h"
#include "app/service.h"
#include "core/fixed.h"
#include "invariants.h"
#include "port/host/flash.h"

#define DAY_SESSION 7u
#define UM (1 << 16)
#define RUN_TICKS 100000u /* 20 s, then the axes are parked and started anew */
#define STATUS_TICKS 2500u
#define QUEUE_TICKS 1000u

struct day {
    struct device device;
    struct host_flash flash;
    struct invariants seen;
    uint64_t ticks, commands, streamed_ticks, moves;
    uint64_t next_streamed; /* tick that the next batch of samples begins with; 0: not known yet */
    uint32_t noise;
    uint16_t next_id;
    uint8_t obeyed;
    int32_t position_codes_q16[AXES];
    struct cobs_decoder decoder;
    uint8_t received[WIRE_MAX_BODY];
};

_Noreturn static void give_up(const struct day *day, const char *what, unsigned value)
{
    fprintf(stderr, "day: %s %u at tick %" PRIu64 ", fault %u\n", what, value, day->device.control.tick,
            (unsigned)day->device.control.fault);
    abort();
}

static void note_obeyed(void *context, const struct wire_header *header)
{
    struct day *day = context;
    day->obeyed = header->type;
}

/* Every tick of the stream, in its order: two runs of it are told apart by STREAM_START. */
static void take_samples(struct day *day, const uint8_t *payload, size_t size)
{
    struct wire_samples samples;
    if (!wire_unpack_samples(&samples, payload, size))
        give_up(day, "samples of size", (unsigned)size);
    if (samples.dropped != 0 || (day->next_streamed != 0 && samples.first_tick != day->next_streamed))
        give_up(day, "a stream with a gap, dropped", samples.dropped);
    const uint64_t ticks = samples.data_size / (AXES * wire_tick_size(WIRE_CHANNEL_ADC | WIRE_CHANNEL_DAC));
    day->next_streamed = samples.first_tick + ticks;
    day->streamed_ticks += ticks;
}

/* Everything that has left the device. Gives the status of the reply among it, or -1. */
static int take_outgoing(struct day *day)
{
    const uint8_t *bytes, *payload;
    size_t size, payload_size;
    struct wire_header header;
    int status = -1;
    while ((bytes = service_outgoing(&day->device, &size)) != NULL) {
        for (size_t i = 0; i < size; i++) {
            if (cobs_decoder_push(&day->decoder, bytes[i]) != COBS_FRAME)
                continue;
            if (!frame_open(day->received, day->decoder.size, &header, &payload, &payload_size))
                give_up(day, "a frame that cannot be opened, size", (unsigned)size);
            if (header.type == WIRE_SAMPLES)
                take_samples(day, payload, payload_size);
            else if (header.type != WIRE_EVENT)
                status = payload[0];
        }
        service_sent(&day->device, size);
    }
    return status;
}

static void ask(struct day *day, uint8_t type, const uint8_t *payload, size_t size)
{
    uint8_t body[WIRE_MAX_BODY], frame[FRAME_MAX];
    const struct wire_header header = {type, ++day->next_id, DAY_SESSION};
    for (size_t i = 0; i < size; i++)
        body[WIRE_HEADER_SIZE + i] = payload[i];
    take_outgoing(day);
    day->obeyed = 0;
    const size_t framed = frame_seal(&header, body, size, frame);
    if (service_receive(&day->device, frame, framed) != framed)
        give_up(day, "not all was taken of command", type);
    invariants_after_command(&day->seen, &day->device, day->obeyed);
    const int status = take_outgoing(day);
    if (status != WIRE_STATUS_OK) {
        fprintf(stderr, "day: status %d\n", status);
        give_up(day, "a refusal of command", type);
    }
    day->commands++;
}

/* A stage of 15 um/V that follows within a millisecond, with a code of noise either way. */
static uint16_t sensed(struct day *day, unsigned axis)
{
    const int32_t u_codes = day->device.dac_codes[axis] - 32768;
    const int32_t goal_q16 = (2341 << 16) + u_codes * 71901; /* 1.0971 sensor codes per DAC code */
    day->position_codes_q16[axis] += (goal_q16 - day->position_codes_q16[axis]) / 4;
    day->noise = day->noise * 1664525u + 1013904223u;
    return (uint16_t)((day->position_codes_q16[axis] >> 16) + (int32_t)(day->noise >> 30) - 1);
}

static void run(struct day *day, uint32_t ticks)
{
    uint16_t adc[AXES], dac[AXES];
    for (uint32_t i = 0; i < ticks; i++) {
        for (unsigned axis = 0; axis < AXES; axis++)
            adc[axis] = sensed(day, axis);
        device_tick(&day->device, adc, dac);
        invariants_after_tick(&day->seen, &day->device);
        day->ticks++;
        if (day->ticks % 64 == 0) {
            take_outgoing(day);
            fault_log_write(&day->device);
        }
        if (day->ticks % STATUS_TICKS == 0)
            ask(day, WIRE_STATUS, NULL, 0);
        if (day->device.control.fault != WIRE_FAULT_NONE)
            give_up(day, "a fault", (unsigned)day->device.control.fault);
    }
}

static void set_up_axis(struct day *day, uint8_t axis)
{
    uint8_t set_payload[WIRE_SET_AXIS_REQUEST_SIZE], path_payload[WIRE_SET_PATH_REQUEST_SIZE];
    const struct wire_set_axis_request set = {
        .axis = axis, .mode = AXIS_PID, .ki_ts_q32 = 1 << 22, .d_alpha_q31 = PID_DERIVATIVE_UNFILTERED};
    const struct wire_set_path_request path = {axis, PATH_HOLD, 0, 20 * UM, 0, 0};
    const struct wire_set_joins_request joins = {.axis = axis, .enter_ticks = 2000};
    uint8_t joins_payload[WIRE_SET_JOINS_REQUEST_SIZE];
    wire_pack_set_axis_request(&set, set_payload, sizeof set_payload);
    wire_pack_set_path_request(&path, path_payload, sizeof path_payload);
    wire_pack_set_joins_request(&joins, joins_payload, sizeof joins_payload);
    ask(day, WIRE_SET_AXIS, set_payload, sizeof set_payload);
    ask(day, WIRE_SET_PATH, path_payload, sizeof path_payload);
    ask(day, WIRE_SET_JOINS, joins_payload, sizeof joins_payload);
}

static void queue_moves(struct day *day, int32_t to_um)
{
    uint8_t payload[WIRE_QUEUE_REQUEST_SIZE];
    struct wire_queue_request queue = {.axis_mask = ALL_AXES};
    for (unsigned axis = 0; axis < AXES; axis++)
        queue.segments[axis] = (struct wire_segment){.path = PATH_MOVE,
                                                     .flags = PATH_FROM_HERE,
                                                     .swing = to_um * UM,
                                                     .step_turn64 = UINT64_MAX / (QUEUE_TICKS - 100),
                                                     .ticks = QUEUE_TICKS - 100,
                                                     .enter_ticks = 200};
    wire_pack_queue_request(&queue, payload, sizeof payload);
    ask(day, WIRE_QUEUE, payload, sizeof payload);
    day->moves += AXES;
}

static void work(struct day *day)
{
    const uint8_t arm[WIRE_ARM_REQUEST_SIZE] = {0}, start[WIRE_START_REQUEST_SIZE] = {ALL_AXES};
    const uint8_t stream[WIRE_STREAM_START_REQUEST_SIZE] = {WIRE_CHANNEL_ADC | WIRE_CHANNEL_DAC, ALL_AXES, 1, 0};
    for (uint8_t axis = 0; axis < AXES; axis++)
        set_up_axis(day, axis);
    ask(day, WIRE_ARM, arm, sizeof arm);
    day->next_streamed = 0;
    ask(day, WIRE_STREAM_START, stream, sizeof stream);
    ask(day, WIRE_START, start, sizeof start);
    run(day, 4 * QUEUE_TICKS);
    for (uint32_t at = 4 * QUEUE_TICKS; at < RUN_TICKS; at += QUEUE_TICKS) {
        queue_moves(day, 20 + (int32_t)(at / QUEUE_TICKS * 37 % 100));
        run(day, QUEUE_TICKS + 100);
    }
    ask(day, WIRE_PARK, NULL, 0);
    run(day, 2500);
    if (day->device.control.state != WIRE_STATE_PARKED)
        give_up(day, "not parked but in state", (unsigned)day->device.control.state);
    ask(day, WIRE_STREAM_STOP, NULL, 0);
}

void day_run(double hours)
{
    static struct day day;
    const uint64_t ticks = (uint64_t)(hours * 3600 * TICK_RATE_HZ);
    static struct fault_log fault_log;
    struct device_port port = {
        .fault_log = &fault_log, .baud = 4000000, .target = "day", .obeyed = note_obeyed, .context = &day};
    host_flash_init(&day.flash, NULL, 0);
    port.flash = host_flash_models(&day.flash);
    port.records = host_flash_journal(&day.flash);
    device_init(&day.device, &port);
    day.device.control.tick = ((uint64_t)1 << 32) - ticks / 2;
    cobs_decoder_init(&day.decoder, day.received, sizeof day.received);
    for (unsigned axis = 0; axis < AXES; axis++)
        day.position_codes_q16[axis] = 2341 << 16;
    invariants_reset(&day.seen, &day.device);
    ask(&day, WIRE_HELLO, NULL, 0);
    while (day.ticks < ticks)
        work(&day);
    take_outgoing(&day);
    printf("{\"ticks\": %" PRIu64 ", \"commands\": %" PRIu64 ", \"moves\": %" PRIu64 ", \"streamed_ticks\": %" PRIu64
           ", \"last_tick\": %" PRIu64 "}\n",
           day.ticks, day.commands, day.moves, day.streamed_ticks, day.device.control.tick);
}
