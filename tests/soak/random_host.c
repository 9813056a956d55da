#include "random_host.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app/device_init.h"
#include "app/device_tick.h"
#include "app/fault_writing.h"
#include "app/reaction.h"
#include "app/service.h"
#include "random_commands.h"

#define ROUNDS_OF_POWER 500
#define ALL_SECTIONS ((1u << LOOP_SECTIONS) - 1)

static uint64_t noise_bits(struct random_host *host)
{
    uint64_t z = host->random += 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

/* The next bytes of the input, lowest first; zeros behind its end. */
static uint64_t taken(struct random_host *host, size_t size)
{
    uint64_t bits = 0;
    for (size_t i = 0; i < size && host->input_left > 0; i++, host->input_left--)
        bits |= (uint64_t)*host->input++ << 8 * i;
    return bits;
}

uint64_t random_bits(struct random_host *host)
{
    return host->input ? taken(host, sizeof(uint64_t)) : noise_bits(host);
}

uint32_t below(struct random_host *host, uint32_t limit)
{
    const uint64_t bits = host->input ? taken(host, limit <= 256 ? 1 : limit <= 65536 ? 2 : 4) : noise_bits(host);
    return limit > 1 ? (uint32_t)(bits % limit) : 0;
}

uint64_t random_value(struct random_host *host)
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
    uint64_t value = below(host, 2) ? EDGES[below(host, sizeof EDGES / sizeof EDGES[0])] : random_bits(host);
    return below(host, 3) ? value >> below(host, 64) : value;
}

void fill(struct random_host *host, uint8_t *to, size_t size)
{
    for (size_t i = 0; i < size; i += 4) {
        uint64_t value = random_value(host);
        memcpy(to + i, &value, size - i < 4 ? size - i : 4);
    }
}

_Noreturn static void give_up(const char *what)
{
    fprintf(stderr, "random_host.c: %s\n", what);
    abort();
}

/* What a tick works with, and what only a command may change while it keeps ticks out. */
static void keep_owned(struct random_host *host)
{
    const struct device *device = &host->device;
    host->owned = device->control;
    memcpy(host->owned_models, device->model_of, sizeof host->owned_models);
    host->owned_rest = device->resting;
}

static void check_owned(const struct random_host *host)
{
    const struct device *device = &host->device;
    if (memcmp(&host->owned, &device->control, sizeof host->owned) != 0 ||
        memcmp(host->owned_models, device->model_of, sizeof host->owned_models) != 0 ||
        host->owned_rest != device->resting)
        give_up("a change of what ticks work with, without their lock");
}

static void lock(void *context)
{
    struct random_host *host = context;
    if (host->locked)
        give_up("a lock that is held already");
    check_owned(host);
    host->locked = true;
}

static void unlock(void *context)
{
    struct random_host *host = context;
    if (!host->locked)
        give_up("an unlock without a lock");
    host->locked = false;
    keep_owned(host);
}

static void take_outgoing(struct random_host *host)
{
    size_t size;
    while (service_outgoing(&host->device, &size) != NULL) {
        if (size > FRAME_MAX)
            give_up("a frame that is too long");
        service_sent(&host->device, 1 + below(host, (uint32_t)size));
    }
}

/* An axis that follows a path in closed loop. */
static bool is_closed(const struct control *now, unsigned axis)
{
    return now->state == WIRE_STATE_RUNNING && now->axis[axis].path.running != 0 &&
           axis_mode_has_feedback(now->config[axis].mode);
}

static void count_reply(struct random_host *host)
{
    const struct control *now = &host->device.control;
    const uint8_t *reply = host->device.line.reply_body + WIRE_HEADER_SIZE;
    host->replies++;
    if (host->obeyed == 0 || reply[0] != WIRE_STATUS_OK)
        return;
    host->done_of[host->obeyed]++;
    for (unsigned axis = 0; axis < AXES && host->obeyed == WIRE_SET_GAINS; axis++)
        host->gains_under_way += is_closed(now, axis) && now->config[axis].filter.in_use == ALL_SECTIONS;
}

static void receive(struct random_host *host, const uint8_t *bytes, size_t size)
{
    while (size > 0) {
        host->obeyed = 0;
        size_t taken = service_receive(&host->device, bytes, size);
        check_owned(host);
        if (host->locked)
            give_up("a lock that is kept");
        invariants_after_command(&host->seen, &host->device, host->obeyed);
        bytes += taken;
        size -= taken;
        if (host->device.line.reply_size != 0)
            count_reply(host);
        if (taken == 0 || below(host, 2))
            take_outgoing(host);
    }
}

void random_host_send(struct random_host *host, uint8_t type, uint64_t session, const uint8_t *payload, size_t size)
{
    static uint8_t body[WIRE_MAX_BODY], frame[FRAME_MAX];
    static size_t last;
    struct wire_header header = {type, below(host, 8) ? ++host->next_id : host->next_id, session};
    if (size > 0)
        memcpy(body + WIRE_HEADER_SIZE, payload, size);
    if (below(host, 16)) /* else: the frame before, again */
        last = frame_seal(&header, body, size, frame);
    host->frames++;
    if (below(host, 64) == 0)
        frame[below(host, (uint32_t)last)] ^= (uint8_t)(1u << below(host, 8));
    receive(host, frame, last);
}

/* As a sensor that works: wild ones end a closed loop at once. */
static uint16_t walked(struct random_host *host, unsigned axis)
{
    uint32_t code = host->codes[axis] + (uint32_t)(noise_bits(host) % 2001);
    host->codes[axis] = (uint16_t)(code < 2000 ? 2000 : code > 64000 ? 62000 : code - 1000);
    return host->codes[axis];
}

static void count_tick(struct random_host *host)
{
    const struct control *now = &host->device.control;
    host->ticks++;
    host->ticks_in[now->state]++;
    for (unsigned axis = 0; axis < AXES && now->state == WIRE_STATE_RUNNING; axis++) {
        host->path_ticks_in[now->config[axis].mode] += now->axis[axis].path.running != 0;
        if (is_closed(now, axis))
            host->filter_ticks[now->config[axis].filter.in_use]++;
    }
}

static void run(struct random_host *host, unsigned count)
{
    uint16_t adc[AXES], dac[AXES];
    const bool railed = below(host, 16) == 0, wild = below(host, 16) == 0;
    for (unsigned i = 0; i < count; i++) {
        for (unsigned axis = 0; axis < AXES; axis++) {
            adc[axis] = walked(host, axis);
            if (railed || wild)
                adc[axis] = (uint16_t)(railed ? UINT16_MAX * (noise_bits(host) % 2) : noise_bits(host));
        }
        const uint32_t fault = host->device.control.fault;
        device_tick(&host->device, adc, dac);
        keep_owned(host);
        invariants_after_tick(&host->seen, &host->device);
        if (host->device.control.fault != fault)
            host->faults_of[host->device.control.fault]++;
        count_tick(host);
        if (noise_bits(host) % 2)
            take_outgoing(host);
        if (noise_bits(host) % 4 == 0)
            fault_log_write(&host->device);
    }
}

static void noise(struct random_host *host)
{
    uint8_t bytes[200];
    size_t size = below(host, sizeof bytes);
    fill(host, bytes, size);
    receive(host, bytes, size);
}

static void note_obeyed(void *context, const struct wire_header *header)
{
    struct random_host *host = context;
    host->obeyed = header->type;
}

/* Counters stand where they are about to wrap, and so may time. */
static void wind_up(struct random_host *host)
{
    static const uint64_t WRAPS[] = {0, (uint64_t)1 << 32, (uint64_t)1 << 63, 0};
    struct device *device = &host->device;
    const uint32_t about = below(host, 3000);
    device->control.tick = WRAPS[below(host, 4)] - (below(host, 4) ? about : 0);
    device->control.queued = 0u - about;
    device->lost_ticks = device->overruns = device->line.rx_errors = 0u - about;
    device->line.kept_next = 0u - about;
    device->events.put = device->events.taken = 0u - about / EVENTS_HELD * EVENTS_HELD;
    device->events.next_id = (uint16_t)(0u - about);
    for (unsigned axis = 0; axis < AXES; axis++)
        device->control.axis[axis].saturations = device->control.axis[axis].near_ticks = 0u - about;
    host->next_id = (uint16_t)(0u - about);
}

/* Power comes, now and then with another flash content. */
static void power_on(struct random_host *host)
{
    struct device_port port = {.fault_log = &host->fault_log,
                               .baud = 2000000,
                               .target = "soak",
                               .reset_cause = (enum wire_reset_cause)below(host, 5),
                               .lock = lock,
                               .unlock = unlock,
                               .obeyed = note_obeyed,
                               .context = host};
    if (host->ticks == 0 || below(host, 3) == 0)
        host_flash_init(&host->flash, NULL, 0);
    else if (below(host, 2))
        fill(host, host->flash.cells.bytes + below(host, HOST_FLASH_CELLS - 8), 8);
    if (below(host, 4) == 0) /* else a reset, which leaves it as it is */
        fill(host, (uint8_t *)&host->fault_log + below(host, sizeof host->fault_log - 8), 8);
    host->flash.power_limited = false;
    port.flash = host_flash_models(&host->flash);
    port.records = host_flash_journal(&host->flash);
    port.update =
        (struct update_port){.flash = host_flash_images(&host->flash),
                             .places = {.address = {0x08020000u, 0x08040000u}, .slot_size = HOST_IMAGE_SLOT_SIZE},
                             .slot = (uint8_t)below(host, IMAGE_SLOTS),
                             .on_trial = below(host, 8) == 0};
    device_init(&host->device, &port);
    update_read_record(&host->device.update, &host->device.port.update);
    host->flash.power_limited = below(host, 4) == 0; /* from some byte on it takes nothing more */
    host->flash.power_left = below(host, 8000);
    if (below(host, 2))
        wind_up(host);
    keep_owned(host);
    invariants_reset(&host->seen, &host->device);
    random_host_send(host, WIRE_HELLO, SESSION, NULL, 0);
    host->rounds = 0;
}

static void raise_fault(struct random_host *host)
{
    const enum wire_fault fault = (enum wire_fault)(1 + below(host, WIRE_FAULT_COUNT - 1));
    if (fault == WIRE_FAULT_TICK_LOST)
        return; /* time goes on by itself with this one */
    device_raise(&host->device, fault, below(host, 4), below(host, 100));
}

static void recover(struct random_host *host)
{
    random_host_send(host, below(host, 2) ? WIRE_PARK : WIRE_STOP, SESSION, NULL, 0);
    run(host, below(host, 1500));
    random_host_send(host, WIRE_CLEAR_FAULT, SESSION, NULL, 0);
}

void random_host_begin(struct random_host *host, uint64_t seed, const uint8_t *input, size_t size)
{
    memset(host, 0, sizeof *host);
    host->random = seed;
    host->input = input;
    host->input_left = size;
    power_on(host);
}

void random_host_round(struct random_host *host)
{
    if (host->rounds++ > ROUNDS_OF_POWER || update_restart_is_due(&host->device.update, host->device.control.tick))
        power_on(host);
    if (host->device.control.state == WIRE_STATE_FAULT && below(host, 4) == 0)
        recover(host);
    if (below(host, 600) == 0)
        send_limits(host);
    switch (below(host, 17)) {
    case 0:
        noise(host);
        break;
    case 1:
    case 2:
        send_mode_and_path(host);
        if (below(host, 2))
            send_joins_and_bounds(host);
        send_arm_and_start(host);
        run(host, below(host, 200));
        send_gains(host);
        run(host, below(host, 2000));
        break;
    case 3:
    case 11:
        send_model(host);
        break;
    case 4:
        send_wave(host);
        break;
    case 5:
        if (below(host, 4) == 0)
            raise_fault(host);
        break;
    case 6:
        recover(host);
        break;
    case 7:
        random_host_send(host, WIRE_HELLO, SESSION, NULL, 0);
        break;
    case 8:
        send_streams(host);
        break;
    case 9:
    case 10:
        send_queue(host);
        run(host, below(host, 500));
        break;
    case 12:
        if (below(host, 4) == 0)
            send_update(host);
        else if (below(host, 4) == 0)
            send_confirm(host);
        break;
    case 13:
        send_gains(host);
        send_marks(host);
        run(host, below(host, 200));
        break;
    case 14:
        send_points(host);
        break;
    default:
        send_random(host);
    }
    run(host, below(host, 40));
}
