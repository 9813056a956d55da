#include "random_commands.h"

#include <string.h>

#include "app/crc32.h"
#include "app/device_tick.h"
#include "app/model_check.h"

#define MODEL_CHUNK 900
#define IMAGE_PART 512 /* a table of vectors */

#define NUMBER_OF(name, number, states, locks_itself) number,

void send_random(struct random_host *host)
{
    static const uint8_t COMMANDS[] = {WIRE_COMMANDS(NUMBER_OF)};
    static uint8_t payload[WIRE_MAX_PAYLOAD];
    uint8_t type = (uint8_t)(below(host, 20) ? COMMANDS[below(host, sizeof COMMANDS)] : below(host, 256));
    const struct wire_message_size *known = wire_message_size(type);
    size_t size = known ? known->fixed + (known->has_tail ? 4 * below(host, 257) : 0) : below(host, 64);
    if (below(host, 20) == 0)
        size = below(host, WIRE_MAX_PAYLOAD + 1);
    if (size > WIRE_MAX_PAYLOAD)
        size = WIRE_MAX_PAYLOAD;
    fill(host, payload, size);
    if (size > 0 && below(host, 4))
        payload[0] = (uint8_t)below(host, 4); /* most begin with an axis */
    random_host_send(host, type, below(host, 30) ? SESSION : random_bits(host), payload, size);
}

static struct wire_biquad stable_section(struct random_host *host)
{
    struct wire_biquad section = {.a1_q26 = (int32_t)below(host, 1 << 25) - (1 << 24),
                                  .a2_q26 = (int32_t)below(host, 1 << 25)};
    section.b0_q26 = (int32_t)below(host, 1 << 29) - (1 << 28);
    section.b1_q26 = BIQUAD_ONE_Q26 + section.a1_q26 + section.a2_q26 - section.b0_q26;
    return section;
}

/* Any that is stable, up to poles that ring for minutes, with numerators up to 16. */
static struct wire_biquad loop_section(struct random_host *host)
{
    const int32_t one = BIQUAD_ONE_Q26;
    const uint32_t inside = 1 + (below(host, 2) ? below(host, 1000) : below(host, (uint32_t)one - 1));
    struct wire_biquad section = {.a2_q26 = below(host, 4) ? one - (int32_t)inside : (int32_t)inside - one};
    const uint32_t most = (uint32_t)(one + section.a2_q26); /* |a1| below it */
    section.a1_q26 = (int32_t)below(host, 2 * most - 1) - (int32_t)(most - 1);
    section.b0_q26 = (int32_t)below(host, 1u << (26 + below(host, 4)));
    section.b2_q26 = (int32_t)below(host, 1u << (26 + below(host, 3)));
    section.b1_q26 = one + section.a1_q26 + section.a2_q26 - section.b0_q26 - section.b2_q26;
    return section;
}

static void make_filters(struct random_host *host, struct wire_biquad filters[LOOP_SECTIONS])
{
    for (unsigned i = 0; i < LOOP_SECTIONS; i++)
        if (below(host, 4))
            filters[i] = loop_section(host);
}

/* Most of them gains with which an axis runs for a while. */
static int32_t random_gain(struct random_host *host)
{
    return (int32_t)(below(host, 2) ? below(host, 1 << 21) : random_value(host) & INT32_MAX);
}

/* One that follows a path, if there is any. */
static uint8_t axis_under_way(struct random_host *host)
{
    uint8_t axis = (uint8_t)below(host, AXES);
    for (unsigned i = 0; i < AXES && host->device.control.axis[axis].drive != DRIVE_PATH; i++)
        axis = (uint8_t)((axis + 1) % AXES);
    return axis;
}

void send_gains(struct random_host *host)
{
    uint8_t payload[WIRE_SET_GAINS_REQUEST_SIZE];
    struct wire_set_gains_request set = {.axis = axis_under_way(host),
                                         .kp_q24 = random_gain(host),
                                         .ki_ts_q32 = random_gain(host),
                                         .kd_over_ts_q24 = random_gain(host),
                                         .d_alpha_q31 = 1 + random_gain(host) / 2};
    make_filters(host, set.filters);
    wire_pack_set_gains_request(&set, payload, sizeof payload);
    random_host_send(host, WIRE_SET_GAINS, SESSION, payload, sizeof payload);
}

void send_mode_and_path(struct random_host *host)
{
    uint8_t payload[WIRE_MAX_PAYLOAD];
    struct wire_set_axis_request set = {.axis = (uint8_t)below(host, AXES),
                                        .mode = (uint8_t)below(host, WIRE_MODE_COUNT),
                                        .kp_q24 = random_gain(host),
                                        .ki_ts_q32 = random_gain(host),
                                        .kd_over_ts_q24 = random_gain(host),
                                        .d_alpha_q31 = 1 + random_gain(host) / 2};
    make_filters(host, set.filters);
    wire_pack_set_axis_request(&set, payload, sizeof payload);
    random_host_send(host, WIRE_SET_AXIS, SESSION, payload, WIRE_SET_AXIS_REQUEST_SIZE);
    int32_t unit = set.mode == AXIS_OPEN ? 1 << 24 : 24 << 16;
    struct wire_set_path_request path = {set.axis,
                                         (uint8_t)below(host, 4),
                                         (int32_t)below(host, 10) * unit,
                                         (int32_t)below(host, 3) * unit,
                                         below(host, 2) ? random_bits(host) >> (1 + below(host, 20))
                                                        : random_value(host),
                                         below(host, 2) ? 0 : below(host, 3000)};
    wire_pack_set_path_request(&path, payload, sizeof payload);
    random_host_send(host, WIRE_SET_PATH, SESSION, payload, WIRE_SET_PATH_REQUEST_SIZE);
}

void send_arm_and_start(struct random_host *host)
{
    uint8_t payload[4] = {0};
    random_host_send(host, WIRE_ARM, SESSION, payload, 4);
    payload[0] = (uint8_t)(1 + below(host, 7));
    random_host_send(host, WIRE_START, SESSION, payload, 1);
}

/* An operator with an inverse, leads, creep and coupling, all of random size. */
static void make_invertible(struct random_host *host, struct wire_axis_model *model, unsigned axis)
{
    int32_t r_q24 = 0, d_q24 = -(3 << 24);
    model->flags |= 2;
    model->preview_ticks_q16 = below(host, 20 << 16);
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++)
        model->shape[i] = stable_section(host);
    model->drive[0] = stable_section(host);
    for (unsigned i = 0; i < CREEP_TERMS; i++) {
        model->creep_k_q30[i] = (int32_t)below(host, 1 << 26) - (1 << 25);
        model->creep_alpha_q48[i] = (int64_t)(random_bits(host) >> (16 + below(host, 40)));
    }
    model->gain_q20 = (int32_t)(1 << 10) + (int32_t)below(host, 80 << 20);
    model->offset_q16 = -(int32_t)below(host, 1 << 19);
    model->rest_fraction_q30 = (int32_t)below(host, 1 << 30);
    for (unsigned i = 0; i < INVERSE_PLAYS; i++) {
        model->play_r_q24[i] = r_q24 += (int32_t)below(host, 1 << 23);
        model->play_w_q20[i] = (int32_t)below(host, 1 << 20);
    }
    for (unsigned j = 0; j < INVERSE_KNOTS; j++) {
        model->knot_d_q24[j] = d_q24 += (int32_t)below(host, 1 << 24);
        model->knot_s_q20[j] = (int32_t)below(host, 1 << 20);
    }
    for (unsigned j = 0; j < AXES; j++)
        model->coupling_q28[j] = j == axis ? DECOUPLE_ONE_Q28 : (int32_t)below(host, 1 << 26) - (1 << 25);
}

void send_model(struct random_host *host)
{
    static uint8_t blob[WIRE_MODEL_SIZE];
    static struct wire_model model;
    model = (struct wire_model){.magic = MODEL_MAGIC};
    for (unsigned i = 0; i < AXES; i++)
        model.axes[i] = (struct wire_axis_model){.flags = 1,
                                                 .u_min_q24 = -(2 << 24),
                                                 .u_max_q24 = 10 << 24,
                                                 .slew_q24 = 3355443,
                                                 .ramp_q24 = 167772,
                                                 .dac_zero_code = 32768,
                                                 .dac_codes_per_V_q16 = 209715200,
                                                 .adc_zero_code = 2341,
                                                 .adc_um_per_code_q32 = 18350080,
                                                 .swing_min_q24 = 1 << 23,
                                                 .swing_max_q24 = 10 << 24,
                                                 .f_min_q16 = 1 << 16,
                                                 .f_max_q16 = 20 << 16,
                                                 .a_q32 = {65513713000, 8426296000, -435080000},
                                                 .b_q40 = {5875700000, 2283600000, 139270000}};
    for (unsigned i = 0; i < AXES; i++) { /* limits of all kinds, some of them impossible */
        int32_t most = (int32_t)below(host, 10);
        model.axes[i].u_min_q24 += (int32_t)(below(host, 40) / 13) << 24;
        model.axes[i].u_max_q24 = most << 24;
        model.axes[i].u_park_q24 = (int32_t)below(host, (uint32_t)most + 1) << 24;
        model.axes[i].slew_q24 >>= below(host, 50) ? (int32_t)below(host, 5) : 24;
        model.axes[i].ramp_q24 = model.axes[i].slew_q24 >> below(host, 3);
        make_invertible(host, &model.axes[i], i);
    }
    wire_pack_model(&model, blob, sizeof blob);
    for (unsigned bent = below(host, 4) ? 0 : 1 + below(host, 2); bent > 0;
         bent--) { /* some fields of it made strange */
        uint64_t value = random_value(host);
        size_t size = below(host, 2) ? 4 : 8;
        memcpy(blob + 36 + 4 * below(host, (WIRE_MODEL_SIZE - 44) / 4), &value, size);
    }
    uint32_t head[2] = {WIRE_MODEL_SIZE, crc32(0, blob, sizeof blob)};
    random_host_send(host, WIRE_MODEL_BEGIN, SESSION, (const uint8_t *)head, sizeof head);
    for (uint32_t at = 0; at < WIRE_MODEL_SIZE; at += MODEL_CHUNK) {
        uint8_t payload[4 + MODEL_CHUNK];
        uint32_t size = at + MODEL_CHUNK < WIRE_MODEL_SIZE ? MODEL_CHUNK : WIRE_MODEL_SIZE - at;
        memcpy(payload, &at, 4);
        memcpy(payload + 4, blob + at, size);
        random_host_send(host, WIRE_MODEL_CHUNK, SESSION, payload, 4 + size);
    }
    random_host_send(host, WIRE_MODEL_COMMIT, SESSION, NULL, 0);
    if (below(host, 4) == 0)
        random_host_send(host, WIRE_MODEL_PERSIST, SESSION, NULL, 0);
}

void send_wave(struct random_host *host)
{
    static int32_t points[WAVE_POINTS];
    uint8_t payload[3 + 4 * 256];
    uint8_t axis = (uint8_t)below(host, 3);
    for (unsigned i = 0; i < WAVE_POINTS; i++)
        points[i] = (int32_t)below(host, (1u << 30) + 1);
    for (uint16_t at = 0; at < WAVE_POINTS; at = (uint16_t)(at + 256)) {
        struct wire_wave_chunk_request chunk = {axis, at, (const uint8_t *)(points + at), 4 * 256};
        wire_pack_wave_chunk_request(&chunk, payload, sizeof payload);
        random_host_send(host, WIRE_WAVE_CHUNK, SESSION, payload, sizeof payload);
    }
    /* One in eight was learned, for some other path. */
    struct wire_wave_commit_request commit = {axis, crc32(0, (const uint8_t *)points, sizeof points), 0,
                                              below(host, 8) == 0};
    wire_pack_wave_commit_request(&commit, payload, sizeof payload);
    random_host_send(host, WIRE_WAVE_COMMIT, SESSION, payload, WIRE_WAVE_COMMIT_REQUEST_SIZE);
}

static void send_piece(struct random_host *host, uint8_t mask, int32_t first, uint32_t count)
{
    static uint8_t payload[WIRE_MAX_PAYLOAD];
    static uint8_t data[AXES * 90 * sizeof(int32_t)];
    const uint32_t axes = (mask & 1u) + (mask >> 1 & 1u) + (mask >> 2 & 1u);
    for (uint32_t i = 0; i < axes * count; i++) {
        const int32_t point = (int32_t)below(host, (1u << 30) + 1);
        memcpy(data + i * sizeof point, &point, sizeof point);
    }
    const struct wire_points_request points = {mask, first, below(host, 4) ? 0 : 1 + below(host, 3000), data,
                                               axes * count * sizeof(int32_t)};
    wire_pack_points_request(&points, payload, sizeof payload);
    random_host_send(host, WIRE_POINTS, SESSION, payload, WIRE_POINTS_REQUEST_SIZE + points.data_size);
}

void send_points(struct random_host *host)
{
    uint8_t payload[WIRE_MAX_PAYLOAD];
    const struct control *control = &host->device.control;
    const uint8_t mask = (uint8_t)(1 + below(host, ALL_AXES)), log2 = (uint8_t)below(host, 4);
    const unsigned axis = (mask & 1u) != 0 ? 0 : (mask & 2u) != 0 ? 1 : 2;
    if (control->points[axis].ring == POINTS_PLAYED && below(host, 4) != 0) {
        send_piece(host, mask, control->points[axis].next, below(host, 91));
        return;
    }
    struct wire_points_begin_request begin = {mask, log2, -(int32_t)below(host, 300), {1u << 30, 1u << 30, 1u << 30}};
    wire_pack_points_begin_request(&begin, payload, sizeof payload);
    random_host_send(host, WIRE_POINTS_BEGIN, SESSION, payload, WIRE_POINTS_BEGIN_REQUEST_SIZE);
    for (unsigned pieces = 1 + below(host, 12); pieces > 0; pieces--)
        send_piece(host, mask, control->points[axis].next, 90);
    const int32_t unit = control->config[axis].mode == AXIS_OPEN ? 1 << 24 : 24 << 16;
    const struct wire_set_path_request path = {
        (uint8_t)axis, WIRE_PATH_KIND_WAVE, (int32_t)below(host, 8) * unit, 0, (uint64_t)1 << (54 - log2), 0};
    wire_pack_set_path_request(&path, payload, sizeof payload);
    random_host_send(host, WIRE_SET_PATH, SESSION, payload, WIRE_SET_PATH_REQUEST_SIZE);
    const struct wire_set_joins_request joins = {(uint8_t)axis, 0, (uint16_t)below(host, 400),
                                                 (uint16_t)below(host, 400)};
    wire_pack_set_joins_request(&joins, payload, sizeof payload);
    random_host_send(host, WIRE_SET_JOINS, SESSION, payload, WIRE_SET_JOINS_REQUEST_SIZE);
}

/* Now and then none, so that all of the range is tried as well. */
void send_limits(struct random_host *host)
{
    uint8_t payload[WIRE_LIMITS_SET_REQUEST_SIZE];
    struct wire_limits_set_request set;
    bool none = below(host, 2) == 0;
    for (unsigned axis = 0; axis < AXES; axis++)
        set.limits[axis] = (struct wire_axis_limits){
            .dac_min = (uint16_t)(none ? 0 : below(host, 32000)),
            .dac_max = (uint16_t)(65535 - (none ? 0 : below(host, 8000))),
            .slew_codes_q16 = none || below(host, 2) ? UINT32_MAX : (uint32_t)random_value(host),
            .adc_min = (uint16_t)(none ? 0 : below(host, 1500)),
            .adc_max = (uint16_t)(65535 - (none ? 0 : below(host, 1500)))};
    wire_pack_limits_set_request(&set, payload, sizeof payload);
    random_host_send(host, WIRE_LIMITS_SET, SESSION, payload, sizeof payload);
}

/* A queue of moves and sines for axes that run. */
void send_queue(struct random_host *host)
{
    uint8_t payload[WIRE_QUEUE_REQUEST_SIZE];
    struct wire_queue_request queue = {.axis_mask = (uint8_t)(1 + below(host, ALL_AXES)),
                                       .at_once = (uint8_t)(below(host, 4) == 0),
                                       .begin_tick =
                                           below(host, 4) ? 0 : host->device.control.tick + below(host, 3000)};
    for (unsigned axis = 0; axis < AXES; axis++) {
        const int32_t unit = host->device.control.config[axis].mode == AXIS_OPEN ? 1 << 24 : 24 << 16;
        const bool from_here = below(host, 4) != 0;
        queue.segments[axis] =
            (struct wire_segment){.path = (uint8_t)below(host, WIRE_PATH_KIND_COUNT),
                                  .flags = (uint8_t)(from_here | (below(host, 2) ? WIRE_PATH_FLAG_MORE : 0)),
                                  .swing = (int32_t)below(host, 8) * unit,
                                  .offset = from_here ? 0 : (int32_t)below(host, 3) * unit,
                                  .step_turn64 = random_bits(host) >> (4 + below(host, 12)),
                                  .ticks = below(host, 3) ? 200 + below(host, 3000) : 0,
                                  .enter_ticks = (uint16_t)(below(host, 4) ? 20 + below(host, 1000) : below(host, 3)),
                                  .leave_ticks = (uint16_t)(below(host, 2) ? below(host, 1000) : 0)};
    }
    queue.at_trigger = (uint8_t)(below(host, 6) == 0);
    wire_pack_queue_request(&queue, payload, sizeof payload);
    random_host_send(host, WIRE_QUEUE, SESSION, payload, sizeof payload);
}

/* Edges at the input come beside it, waited for or not. */
void send_marks(struct random_host *host)
{
    uint8_t payload[WIRE_TRIGGER_SET_REQUEST_SIZE];
    for (unsigned i = 0; i < TRIGGERS; i++) {
        const struct wire_trigger_set_request set = {.output = (uint8_t)below(host, TRIGGERS),
                                                     .mark = (uint8_t)below(host, WIRE_MARK_COUNT),
                                                     .axis = axis_under_way(host),
                                                     .rising = (uint8_t)below(host, 2),
                                                     .every =
                                                         below(host, 2) ? below(host, 1 << 16) : random_value(host),
                                                     .origin = (int32_t)random_value(host)};
        wire_pack_trigger_set_request(&set, payload, sizeof payload);
        random_host_send(host, WIRE_TRIGGER_SET, SESSION, payload, sizeof payload);
    }
    device_trigger_edge(&host->device);
}

void send_joins_and_bounds(struct random_host *host)
{
    uint8_t joins_payload[WIRE_SET_JOINS_REQUEST_SIZE], motion_payload[WIRE_MOTION_REQUEST_SIZE];
    struct wire_set_joins_request joins = {(uint8_t)below(host, AXES), (uint8_t)below(host, 4),
                                           (uint16_t)(below(host, 2) ? 0 : below(host, 2000)),
                                           (uint16_t)(below(host, 2) ? 0 : below(host, 2000))};
    wire_pack_set_joins_request(&joins, joins_payload, sizeof joins_payload);
    random_host_send(host, WIRE_SET_JOINS, SESSION, joins_payload, sizeof joins_payload);
    struct wire_motion_request motion = {.axis = (uint8_t)below(host, AXES),
                                         .velocity = below(host, 2) ? 0 : random_bits(host) >> (16 + below(host, 24)),
                                         .window_q16 = (int32_t)below(host, 1 << 20),
                                         .window_ticks = below(host, 1000)};
    wire_pack_motion_request(&motion, motion_payload, sizeof motion_payload);
    random_host_send(host, WIRE_MOTION, SESSION, motion_payload, sizeof motion_payload);
}

void send_streams(struct random_host *host)
{
    uint8_t payload[WIRE_STREAM_START_REQUEST_SIZE], arm_payload[WIRE_TRANSIENT_ARM_REQUEST_SIZE];
    struct wire_stream_start_request stream = {(uint8_t)(1 + below(host, 31)), (uint8_t)(1 + below(host, ALL_AXES)),
                                               (uint16_t)(1 + below(host, 50))};
    struct wire_transient_arm_request arm = {.trigger = (uint8_t)below(host, WIRE_TRIGGER_COUNT),
                                             .axis = (uint8_t)below(host, AXES),
                                             .channel = (uint8_t)(1u << below(host, 3)),
                                             .falling = (uint8_t)below(host, 2),
                                             .level = (int32_t)below(host, 65536),
                                             .decimation = (uint16_t)(1 + below(host, 3)),
                                             .after = (uint16_t)below(host, 500)};
    wire_pack_stream_start_request(&stream, payload, sizeof payload);
    random_host_send(host, WIRE_STREAM_START, SESSION, payload, sizeof payload);
    wire_pack_transient_arm_request(&arm, arm_payload, sizeof arm_payload);
    random_host_send(host, WIRE_TRANSIENT_ARM, SESSION, arm_payload, sizeof arm_payload);
}

/* The image that runs is confirmed, as a host does that has just started it. */
void send_confirm(struct random_host *host)
{
    struct wire_update_confirm_request confirm;
    uint8_t payload[WIRE_UPDATE_CONFIRM_REQUEST_SIZE];
    memcpy(confirm.build_id, host->device.port.build_id, sizeof confirm.build_id);
    wire_pack_update_confirm_request(&confirm, payload, sizeof payload);
    random_host_send(host, WIRE_UPDATE_CONFIRM, SESSION, payload, sizeof payload);
}

/* An image for the slot that does not run, most of them whole. */
void send_update(struct random_host *host)
{
    const struct update_port *port = &host->device.port.update;
    uint8_t chunk[4 + IMAGE_PART];
    struct image_header header = {.magic = IMAGE_MAGIC,
                                  .length = IMAGE_HEADER_SIZE + IMAGE_PART,
                                  .address = port->places.address[1 - port->slot],
                                  .version = 1};
    const uint32_t offset = IMAGE_HEADER_SIZE;
    memcpy(header.target, host->device.port.target, strlen(host->device.port.target));
    memcpy(chunk, &offset, 4);
    fill(host, chunk + 4, IMAGE_PART);
    header.crc = crc32(0, (const uint8_t *)&header + IMAGE_CRC_FROM, IMAGE_HEADER_SIZE - IMAGE_CRC_FROM);
    header.crc = crc32(header.crc, chunk + 4, IMAGE_PART) ^ (below(host, 8) == 0);
    random_host_send(host, WIRE_UPDATE_BEGIN, SESSION, (const uint8_t *)&header, sizeof header);
    random_host_send(host, WIRE_UPDATE_CHUNK, SESSION, chunk, sizeof chunk);
    random_host_send(host, WIRE_UPDATE_COMMIT, SESSION, NULL, 0);
    if (below(host, 4) == 0)
        random_host_send(host, WIRE_UPDATE_RESTART, SESSION, NULL, 0);
}
