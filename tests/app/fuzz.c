/* Throws bytes, frames, samples and faults at a device and checks after every tick that no output has jumped, left its
 * limits, or ended in a state that has no name. Built with the sanitizers. Usage: fuzz SEED ROUNDS */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app/crc32.h"
#include "app/device_init.h"
#include "app/device_tick.h"
#include "app/fault_writing.h"
#include "app/model_check.h"
#include "app/reaction.h"
#include "app/service.h"
#include "port/host/flash.h"

#define SESSION 0x1122334455667788u
#define CHECK(condition) ((condition) ? (void)0 : fail(#condition, __LINE__))

static struct device device;
static struct host_flash flash;
static uint64_t random_state;
static uint16_t next_id;
static uint32_t replies, frames, ok_replies, ticks;
static uint32_t running_ticks, inverse_ticks, faults;
static bool armed; /* since the last reset */
static uint16_t codes[AXES];

_Noreturn static void fail(const char *what, int line)
{
    fprintf(stderr, "line %d: %s (tick %" PRIu64 ")\n", line, what, device.control.tick);
    abort();
}

static uint64_t random_bits(void)
{
    uint64_t z = random_state += 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

static uint32_t below(uint32_t limit)
{
    CHECK(limit > 0);
    return (uint32_t)(random_bits() % limit);
}

/* Numbers at which code breaks, and numbers in between. */
static uint64_t random_value(void)
{
    static const uint64_t EDGES[] = {0,
                                     1,
                                     2,
                                     3,
                                     255,
                                     65535,
                                     INT32_MAX,
                                     (uint64_t)INT32_MIN,
                                     UINT32_MAX,
                                     INT64_MAX,
                                     (uint64_t)INT64_MIN,
                                     UINT64_MAX,
                                     1u << 24,
                                     60u << 16};
    uint64_t value = below(2) ? EDGES[below(sizeof EDGES / sizeof EDGES[0])] : random_bits();
    return below(3) ? value >> below(64) : value;
}

static void fill(uint8_t *to, size_t size)
{
    for (size_t i = 0; i < size; i += 4) {
        uint64_t value = random_value();
        memcpy(to + i, &value, size - i < 4 ? size - i : 4);
    }
}

static void take_outgoing(void)
{
    size_t size;
    while (service_outgoing(&device, &size) != NULL) {
        CHECK(size <= FRAME_MAX);
        service_sent(&device, 1 + below((uint32_t)size));
    }
}

static void receive(const uint8_t *bytes, size_t size)
{
    while (size > 0) {
        size_t taken = service_receive(&device, bytes, size);
        bytes += taken;
        size -= taken;
        if (device.line.reply_size != 0) {
            replies++;
            ok_replies += device.line.reply_body[WIRE_HEADER_SIZE] == WIRE_STATUS_OK;
        }
        if (taken == 0 || below(2))
            take_outgoing();
    }
}

static void send(uint8_t type, uint64_t session, const uint8_t *payload, size_t size)
{
    static uint8_t body[WIRE_MAX_BODY], frame[FRAME_MAX];
    static size_t last;
    struct wire_header header = {type, below(8) ? ++next_id : next_id, session};
    if (size > 0)
        memcpy(body + WIRE_HEADER_SIZE, payload, size);
    if (below(16)) /* else: the frame before, again */
        last = frame_seal(&header, body, size, frame);
    frames++;
    if (below(64) == 0)
        frame[below((uint32_t)last)] ^= (uint8_t)(1u << below(8));
    receive(frame, last);
}

static void send_random(void)
{
    static uint8_t payload[WIRE_MAX_PAYLOAD];
    uint8_t type = (uint8_t)(below(20) ? 1 + below(WIRE_INFO) : below(256));
    const struct wire_message_size *known = wire_message_size(type);
    size_t size = known ? known->fixed + (known->has_tail ? 4 * below(257) : 0) : below(64);
    if (below(20) == 0)
        size = below(WIRE_MAX_PAYLOAD + 1);
    if (size > WIRE_MAX_PAYLOAD)
        size = WIRE_MAX_PAYLOAD;
    fill(payload, size);
    if (size > 0 && below(4))
        payload[0] = (uint8_t)below(4); /* most begin with an axis */
    send(type, below(30) ? SESSION : random_bits(), payload, size);
}

static void send_mode_and_path(void)
{
    uint8_t payload[WIRE_SET_PATH_REQUEST_SIZE];
    struct wire_set_axis_request set = {(uint8_t)below(3),
                                        (uint8_t)below(WIRE_MODE_COUNT),
                                        (int32_t)(random_value() >> 1 & INT32_MAX),
                                        (int32_t)(random_value() & INT32_MAX),
                                        (int32_t)(random_value() & INT32_MAX),
                                        (int32_t)(1 + (random_value() & INT32_MAX) / 2)};
    wire_pack_set_axis_request(&set, payload, sizeof payload);
    send(WIRE_SET_AXIS, SESSION, payload, WIRE_SET_AXIS_REQUEST_SIZE);
    int32_t unit = set.mode == AXIS_OPEN ? 1 << 24 : 24 << 16;
    struct wire_set_path_request path = {set.axis,
                                         (uint8_t)below(4),
                                         (int32_t)below(10) * unit,
                                         (int32_t)below(3) * unit,
                                         below(2) ? random_bits() >> (1 + below(20)) : random_value(),
                                         below(2) ? 0 : below(3000)};
    wire_pack_set_path_request(&path, payload, sizeof payload);
    send(WIRE_SET_PATH, SESSION, payload, WIRE_SET_PATH_REQUEST_SIZE);
}

static void send_arm_and_start(void)
{
    uint8_t payload[4] = {0};
    send(WIRE_ARM, SESSION, payload, 4);
    payload[0] = (uint8_t)(1 + below(7));
    send(WIRE_START, SESSION, payload, 1);
}

#define MODEL_CHUNK 900

static struct wire_biquad stable_section(void)
{
    struct wire_biquad section = {.a1_q26 = (int32_t)below(1 << 25) - (1 << 24), .a2_q26 = (int32_t)below(1 << 25)};
    section.b0_q26 = (int32_t)below(1 << 29) - (1 << 28);
    section.b1_q26 = BIQUAD_ONE_Q26 + section.a1_q26 + section.a2_q26 - section.b0_q26;
    return section;
}

/* An operator with an inverse, leads, creep and coupling, all of random size. */
static void make_invertible(struct wire_axis_model *model, unsigned axis)
{
    int32_t r_q24 = 0, d_q24 = -(3 << 24);
    model->flags |= 2;
    model->preview_ticks_q16 = below(20 << 16);
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++)
        model->shape[i] = stable_section();
    model->drive[0] = stable_section();
    for (unsigned i = 0; i < CREEP_TERMS; i++) {
        model->creep_k_q30[i] = (int32_t)below(1 << 26) - (1 << 25);
        model->creep_alpha_q48[i] = (int64_t)(random_bits() >> (16 + below(40)));
    }
    model->gain_q20 = (int32_t)(1 << 10) + (int32_t)below(80 << 20);
    model->offset_q16 = -(int32_t)below(1 << 19);
    model->rest_fraction_q30 = (int32_t)below(1 << 30);
    for (unsigned i = 0; i < INVERSE_PLAYS; i++) {
        model->play_r_q24[i] = r_q24 += (int32_t)below(1 << 23);
        model->play_w_q20[i] = (int32_t)below(1 << 20);
    }
    for (unsigned j = 0; j < INVERSE_KNOTS; j++) {
        model->knot_d_q24[j] = d_q24 += (int32_t)below(1 << 24);
        model->knot_s_q20[j] = (int32_t)below(1 << 20);
    }
    for (unsigned j = 0; j < AXES; j++)
        model->coupling_q28[j] = j == axis ? DECOUPLE_ONE_Q28 : (int32_t)below(1 << 26) - (1 << 25);
}

static void send_model(void)
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
        int32_t most = (int32_t)below(10);
        model.axes[i].u_min_q24 += (int32_t)(below(40) / 13) << 24;
        model.axes[i].u_max_q24 = most << 24;
        model.axes[i].u_park_q24 = (int32_t)below((uint32_t)most + 1) << 24;
        model.axes[i].slew_q24 >>= below(50) ? (int32_t)below(5) : 24;
        model.axes[i].ramp_q24 = model.axes[i].slew_q24 >> below(3);
        make_invertible(&model.axes[i], i);
    }
    wire_pack_model(&model, blob, sizeof blob);
    for (unsigned bent = below(4) ? 0 : 1 + below(2); bent > 0; bent--) { /* some fields of it made strange */
        uint64_t value = random_value();
        size_t size = below(2) ? 4 : 8;
        memcpy(blob + 36 + 4 * below((WIRE_MODEL_SIZE - 44) / 4), &value, size);
    }
    uint32_t head[2] = {WIRE_MODEL_SIZE, crc32(0, blob, sizeof blob)};
    send(WIRE_MODEL_BEGIN, SESSION, (const uint8_t *)head, sizeof head);
    for (uint32_t at = 0; at < WIRE_MODEL_SIZE; at += MODEL_CHUNK) {
        uint8_t payload[4 + MODEL_CHUNK];
        uint32_t size = at + MODEL_CHUNK < WIRE_MODEL_SIZE ? MODEL_CHUNK : WIRE_MODEL_SIZE - at;
        memcpy(payload, &at, 4);
        memcpy(payload + 4, blob + at, size);
        send(WIRE_MODEL_CHUNK, SESSION, payload, 4 + size);
    }
    send(WIRE_MODEL_COMMIT, SESSION, NULL, 0);
    if (below(4) == 0)
        send(WIRE_MODEL_PERSIST, SESSION, NULL, 0);
}

static void send_wave(void)
{
    static int32_t points[WAVE_POINTS];
    uint8_t payload[3 + 4 * 256];
    uint8_t axis = (uint8_t)below(3);
    for (unsigned i = 0; i < WAVE_POINTS; i++)
        points[i] = (int32_t)below((1u << 30) + 1);
    for (uint16_t at = 0; at < WAVE_POINTS; at = (uint16_t)(at + 256)) {
        struct wire_wave_chunk_request chunk = {axis, at, (const uint8_t *)(points + at), 4 * 256};
        wire_pack_wave_chunk_request(&chunk, payload, sizeof payload);
        send(WIRE_WAVE_CHUNK, SESSION, payload, sizeof payload);
    }
    struct wire_wave_commit_request commit = {axis, crc32(0, (const uint8_t *)points, sizeof points)};
    wire_pack_wave_commit_request(&commit, payload, sizeof payload);
    send(WIRE_WAVE_COMMIT, SESSION, payload, WIRE_WAVE_COMMIT_REQUEST_SIZE);
}

/* Now and then none, so that all of the range is tried as well. */
static void send_limits(void)
{
    uint8_t payload[WIRE_LIMITS_SET_REQUEST_SIZE];
    struct wire_limits_set_request set;
    bool none = below(2) == 0;
    for (unsigned axis = 0; axis < AXES; axis++)
        set.limits[axis] =
            (struct wire_axis_limits){.dac_min = (uint16_t)(none ? 0 : below(32000)),
                                      .dac_max = (uint16_t)(65535 - (none ? 0 : below(8000))),
                                      .slew_codes_q16 = none || below(2) ? UINT32_MAX : (uint32_t)random_value(),
                                      .adc_min = (uint16_t)(none ? 0 : below(1500)),
                                      .adc_max = (uint16_t)(65535 - (none ? 0 : below(1500)))};
    wire_pack_limits_set_request(&set, payload, sizeof payload);
    send(WIRE_LIMITS_SET, SESSION, payload, sizeof payload);
}

static void check(const struct control *before)
{
    const struct control *now = &device.control;
    CHECK(now->state < WIRE_STATE_COUNT && now->fault < WIRE_FAULT_COUNT);
    CHECK((now->fault != WIRE_FAULT_NONE) == (now->state == WIRE_STATE_FAULT));
    armed = armed || now->state == WIRE_STATE_ARMED || now->state == WIRE_STATE_RUNNING;
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct axis_config *config = &now->config[axis];
        CHECK(armed || now->axis[axis].u_q24 == 0);
        int64_t step = (int64_t)now->axis[axis].u_q24 - before->axis[axis].u_q24;
        CHECK(step <= config->output.slew_q24 && step >= -(int64_t)config->output.slew_q24);
        CHECK(now->axis[axis].u_q24 >= config->output.u_min_q24 && now->axis[axis].u_q24 <= config->output.u_max_q24);
        CHECK(config->mode < WIRE_MODE_COUNT && config->path.kind < WIRE_PATH_KIND_COUNT);
        const struct wire_axis_limits *limits = &device.journal.newest.limits[axis];
        uint16_t code = device.dac_codes[axis];
        CHECK(now->axis[axis].u_q24 == 0 || (code >= limits->dac_min && code <= limits->dac_max));
        if (now->state == WIRE_STATE_PARKED || now->state == WIRE_STATE_STOPPING)
            CHECK(step <= config->ramp_q24 && step >= -(int64_t)config->ramp_q24);
    }
}

/* As a sensor that works: wild ones end a closed loop at once. */
static uint16_t walked(unsigned axis)
{
    uint32_t code = codes[axis] + below(2001);
    codes[axis] = (uint16_t)(code < 2000 ? 2000 : code > 64000 ? 62000 : code - 1000);
    return codes[axis];
}

static void run(unsigned count)
{
    uint16_t adc[AXES], dac[AXES];
    bool railed = below(16) == 0, wild = below(16) == 0;
    for (unsigned i = 0; i < count; i++) {
        struct control before = device.control;
        for (unsigned axis = 0; axis < AXES; axis++)
            adc[axis] = railed ? (uint16_t)(UINT16_MAX * below(2)) : wild ? (uint16_t)random_bits() : walked(axis);
        device_tick(&device, adc, dac);
        check(&before);
        ticks++;
        running_ticks += device.control.state == WIRE_STATE_RUNNING;
        for (unsigned axis = 0; axis < AXES; axis++)
            inverse_ticks += device.control.state == WIRE_STATE_RUNNING && device.control.axis[axis].path.running &&
                             axis_mode_inverts(device.control.config[axis].mode);
        if (below(2))
            take_outgoing();
        if (below(4) == 0)
            fault_log_write(&device);
    }
}

static void noise(void)
{
    uint8_t bytes[200];
    size_t size = below(sizeof bytes);
    fill(bytes, size);
    receive(bytes, size);
}

static void round_trip(void)
{
    if (below(600) == 0)
        send_limits();
    switch (below(13)) {
    case 0:
        noise();
        break;
    case 1:
    case 12:
        send_mode_and_path();
        send_arm_and_start();
        run(below(2000));
        break;
    case 2:
        send_model();
        break;
    case 3:
        send_wave();
        break;
    case 4:
        if (below(4) == 0) {
            device_raise(&device, (enum wire_fault)(1 + below(WIRE_FAULT_COUNT - 1)), below(4), below(100));
            faults++;
        }
        break;
    case 5:
        send(below(2) ? WIRE_PARK : WIRE_STOP, SESSION, NULL, 0);
        run(below(1500));
        send(WIRE_CLEAR_FAULT, SESSION, NULL, 0);
        break;
    case 6:
        send(WIRE_HELLO, SESSION, NULL, 0);
        break;
    default:
        send_random();
    }
    run(below(40));
}

int main(int count, char **arguments)
{
    random_state = count > 1 ? strtoull(arguments[1], NULL, 10) : 0;
    uint32_t rounds = count > 2 ? (uint32_t)strtoul(arguments[2], NULL, 10) : 10000;
    for (uint32_t i = 0; i < rounds; i++) {
        if (i % 2000 == 0 ||
            update_restart_is_due(&device.update,
                                  device.control.tick)) { /* a power cycle, now and then with another flash content */
            struct device_port port = {
                .baud = 2000000, .target = "fuzz", .reset_cause = (enum wire_reset_cause)below(5)};
            if (i == 0 || below(3) == 0)
                host_flash_init(&flash, NULL, 0);
            else if (below(2))
                fill(flash.cells.bytes + below(HOST_FLASH_CELLS - 8), 8);
            port.flash = host_flash_models(&flash);
            port.records = host_flash_journal(&flash);
            port.update = (struct update_port){
                .flash = host_flash_images(&flash),
                .places = {.address = {0x08020000u, 0x08040000u}, .slot_size = HOST_IMAGE_SLOT_SIZE},
                .slot = (uint8_t)below(IMAGE_SLOTS)};
            device_init(&device, &port);
            update_read_record(&device.update, &device.port.update);
            armed = false;
            send(WIRE_HELLO, SESSION, NULL, 0);
        }
        round_trip();
    }
    printf("%u %u %u %u %u %u %u\n", frames, replies, ok_replies, ticks, running_ticks, inverse_ticks, faults);
    return 0;
}
