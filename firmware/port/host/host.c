#include "port/host/host.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "app/build_id.h"
#include "app/device_init.h"
#include "app/device_tick.h"
#include "app/fault_writing.h"
#include "app/reaction.h"
#include "app/service.h"
#include "core/fixed.h"
#include "plant.h"
#include "port/host/flash.h"

#define LINE_BITS_PER_BYTE 10
#define INJECTED_RAIL_TICKS (2 * WATCH_RAIL_TICKS)

struct host_device {
    struct device device;
    struct device_port port;
    struct host_flash flash;
    struct fault_log fault_log; /* a restart leaves it as it is */
    uint64_t line_credit;       /* bits x TICK_RATE_HZ that the line could still have carried in this tick */
    bool infinite_line;
    unsigned rail_axis, rail_ticks; /* forced to the rail for so many ticks more */
    uint64_t edges[HOST_EDGES];     /* ticks before which one comes at the trigger input */
    unsigned edge_count;
    size_t out_first, out_size; /* ring of bytes that have left the device */
    uint8_t *in;                /* bytes the device has not taken yet */
    size_t in_first, in_size, in_capacity;
    struct host_obeyed obeyed[HOST_OBEYED]; /* a ring */
    uint64_t obeyed_count;                  /* since they were taken last */
    uint8_t out[HOST_LINE_SIZE];
};

static const char TARGET[] = "host";

static void note_obeyed(void *context, const struct wire_header *header)
{
    struct host_device *host = context;
    host->obeyed[host->obeyed_count++ % HOST_OBEYED] = (struct host_obeyed){header->session, header->id, header->type};
}

uint64_t host_take_obeyed(struct host_device *host, struct host_obeyed *commands, size_t capacity)
{
    uint64_t count = host->obeyed_count;
    uint64_t kept = count < HOST_OBEYED ? count : HOST_OBEYED;
    for (uint64_t i = 0; i < kept && i < capacity; i++)
        commands[i] = host->obeyed[(count - kept + i) % HOST_OBEYED];
    host->obeyed_count = 0;
    return count;
}

static const struct boot_places PLACES = {.address = {0x08020000u, 0x08040000u}, .slot_size = HOST_IMAGE_SLOT_SIZE};

/* What a bootloader does. Whatever the image holds, this library's code runs; but it says the image's build id. */
static void boot(struct host_device *host, enum wire_reset_cause cause)
{
    struct boot_choice choice;
    struct flash_port images = host_flash_images(&host->flash);
    boot_choose(&images, &PLACES, image_crc, &choice);
    host->port.reset_cause = cause;
    host->port.update = (struct update_port){.flash = images, .places = PLACES, .on_trial = choice.trial};
    build_id(host->port.build_id);
    if (choice.slot != BOOT_NO_SLOT) {
        host->port.update.slot = (uint8_t)choice.slot;
        memcpy(host->port.build_id, choice.header.build_id, sizeof host->port.build_id);
    }
    device_init(&host->device, &host->port);
    update_read_record(&host->device.update, &host->device.port.update);
}

struct host_device *host_open(uint32_t baud, const uint8_t *flash, size_t flash_size)
{
    struct host_device *host = calloc(1, sizeof *host);
    if (!host)
        return NULL;
    if (!host_flash_init(&host->flash, flash, flash_size)) {
        free(host);
        return NULL;
    }
    host->port = (struct device_port){.flash = host_flash_models(&host->flash),
                                      .records = host_flash_journal(&host->flash),
                                      .fault_log = &host->fault_log,
                                      .obeyed = note_obeyed,
                                      .context = host,
                                      .baud = baud,
                                      .target = TARGET};
    boot(host, WIRE_RESET_CAUSE_POWER_ON);
    return host;
}

void host_close(struct host_device *host)
{
    if (host)
        free(host->in);
    free(host);
}

size_t host_readable(const struct host_device *host)
{
    return host->out_size;
}

uint64_t host_tick(const struct host_device *host)
{
    return host->device.control.tick;
}

static void put_out(struct host_device *host, const uint8_t *bytes, size_t size)
{
    size_t at = (host->out_first + host->out_size) % HOST_LINE_SIZE;
    size_t part = size < HOST_LINE_SIZE - at ? size : HOST_LINE_SIZE - at;
    memcpy(host->out + at, bytes, part);
    memcpy(host->out, bytes + part, size - part);
    host->out_size += size;
}

size_t host_read(struct host_device *host, uint8_t *bytes, size_t size)
{
    if (size > host->out_size)
        size = host->out_size;
    size_t part = size < HOST_LINE_SIZE - host->out_first ? size : HOST_LINE_SIZE - host->out_first;
    memcpy(bytes, host->out + host->out_first, part);
    memcpy(bytes + part, host->out, size - part);
    host->out_first = (host->out_first + size) % HOST_LINE_SIZE;
    host->out_size -= size;
    return size;
}

/* Lets the device send what `*bytes` allow, as far as there is room for it. */
static void send(struct host_device *host, uint64_t *bytes)
{
    size_t size;
    const uint8_t *from;
    while (*bytes > 0 && (from = service_outgoing(&host->device, &size)) != NULL) {
        size_t room = HOST_LINE_SIZE - host->out_size;
        if (size > *bytes)
            size = (size_t)*bytes;
        if (!host->infinite_line) {
            size = size < room ? size : room;
            if (size == 0)
                return;
            put_out(host, from, size);
        }
        service_sent(&host->device, size);
        *bytes -= size;
    }
}

static void take_in(struct host_device *host)
{
    while (host->in_size > 0) {
        size_t taken = service_receive(&host->device, host->in + host->in_first, host->in_size);
        host->in_first += taken;
        host->in_size -= taken;
        if (host->infinite_line) {
            uint64_t bytes = UINT64_MAX;
            send(host, &bytes);
        } else if (taken == 0) {
            return;
        }
    }
    host->in_first = 0;
}

size_t host_write(struct host_device *host, const uint8_t *bytes, size_t size)
{
    if (host->in_first + host->in_size + size > host->in_capacity) {
        size_t capacity = 2 * (host->in_size + size) + 4096;
        uint8_t *grown = malloc(capacity);
        if (!grown)
            return 0;
        if (host->in_size > 0)
            memcpy(grown, host->in + host->in_first, host->in_size);
        free(host->in);
        host->in = grown;
        host->in_first = 0;
        host->in_capacity = capacity;
    }
    if (size > 0)
        memcpy(host->in + host->in_first + host->in_size, bytes, size);
    host->in_size += size;
    take_in(host);
    return size;
}

static void force_rail(struct host_device *host, uint16_t adc_codes[AXES])
{
    if (host->rail_ticks == 0)
        return;
    host->rail_ticks--;
    adc_codes[host->rail_axis] = UINT16_MAX;
}

static void give_edge(struct host_device *host)
{
    for (unsigned i = host->edge_count; i-- > 0;)
        if (host->edges[i] <= host->device.control.tick) {
            host->edges[i] = host->edges[--host->edge_count];
            device_trigger_edge(&host->device);
        }
}

int host_trigger_at(struct host_device *host, uint64_t tick)
{
    if (tick < host->device.control.tick || host->edge_count >= HOST_EDGES)
        return 0;
    host->edges[host->edge_count++] = tick;
    return 1;
}

/* The line carries a number of bytes each tick; capacity that was not used is lost, as on an idle line. */
static void run_line(struct host_device *host)
{
    host->line_credit += host->port.baud;
    uint64_t bytes = host->line_credit / ((uint64_t)LINE_BITS_PER_BYTE * TICK_RATE_HZ);
    uint64_t left = bytes;
    send(host, &left);
    if (left > 0)
        host->line_credit = 0;
    else
        host->line_credit -= bytes * LINE_BITS_PER_BYTE * TICK_RATE_HZ;
}

static void restart_when_due(struct host_device *host)
{
    if (update_restart_is_due(&host->device.update, host->device.control.tick))
        boot(host, WIRE_RESET_CAUSE_SOFTWARE);
}

uint64_t host_run(struct host_device *host, struct plant *plant, uint64_t ticks, size_t want_bytes)
{
    uint16_t adc_codes[AXES], dac_codes[AXES];
    for (uint64_t done = 0; done < ticks; done++) {
        if (want_bytes > 0 && host->out_size >= want_bytes)
            return done;
        if (host->in_size > 0)
            take_in(host);
        plant_sample(plant, adc_codes);
        force_rail(host, adc_codes);
        give_edge(host);
        device_tick(&host->device, adc_codes, dac_codes);
        plant_drive(plant, dac_codes);
        run_line(host);
        fault_log_write(&host->device);
        restart_when_due(host);
    }
    return ticks;
}

void host_run_codes(struct host_device *host, const uint16_t *adc_codes, uint16_t *dac_codes, uint64_t ticks)
{
    for (uint64_t i = 0; i < ticks; i++) {
        uint64_t bytes = UINT64_MAX;
        if (host->in_size > 0)
            take_in(host);
        give_edge(host);
        device_tick(&host->device, adc_codes + AXES * i, dac_codes + AXES * i);
        send(host, &bytes);
        fault_log_write(&host->device);
        restart_when_due(host);
    }
}

size_t host_state_size(void)
{
    return sizeof(struct control);
}

static bool is_control(const struct control *control)
{
    if (control->state >= WIRE_STATE_COUNT || control->fault >= WIRE_FAULT_COUNT || control->path_mask >> AXES != 0)
        return false;
    for (unsigned i = 0; i < TRIGGERS; i++)
        if (control->trigger[i].config.mark >= WIRE_MARK_COUNT || control->trigger[i].config.axis >= AXES)
            return false;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (control->config[axis].mode >= WIRE_MODE_COUNT || control->config[axis].path.kind >= WIRE_PATH_KIND_COUNT ||
            control->axis[axis].drive > DRIVE_RAMP || control->queue[axis].count > SEGMENTS_QUEUED ||
            control->axis[axis].join.path.kind >= WIRE_PATH_KIND_COUNT ||
            !loop_filter_is_usable(&control->config[axis].filter))
            return false;
    return true;
}

static enum host_restored missing(const struct device *device, const struct control *control)
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct axis_config *config = &control->config[axis];
        if (config->path.kind == PATH_WAVE && !device_wave_q30(device, axis))
            return HOST_WITHOUT_WAVE;
        if (axis_mode_uses_tables(config->mode) && !device_tables(device, axis))
            return HOST_WITHOUT_MODEL;
        if (axis_mode_inverts(config->mode) && !device_compensation(device, axis))
            return HOST_WITHOUT_MODEL;
    }
    return HOST_RESTORED;
}

int host_restore(struct host_device *host, uint64_t session, const uint8_t *state, size_t size)
{
    struct control control;
    if (size != sizeof control)
        return HOST_NOT_A_STATE;
    memcpy(&control, state, sizeof control);
    if (!is_control(&control))
        return HOST_NOT_A_STATE;
    enum host_restored restored = missing(&host->device, &control);
    if (restored != HOST_RESTORED)
        return restored;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (host->device.model_of[axis].compensation)
            compensation_admit(host->device.model_of[axis].compensation, &control.axis[axis].compensation);
    host->device.control = control;
    device_link_models(&host->device);
    host->device.session = session;
    host->device.host_is_recorded = true;
    host->infinite_line = true;
    return HOST_RESTORED;
}

uint32_t host_driven_axes(const struct host_device *host)
{
    uint32_t mask = 0;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (host->device.control.axis[axis].drive == DRIVE_PATH)
            mask |= 1u << axis;
    return mask;
}

const uint8_t *host_flash(const struct host_device *host, size_t *size, uint64_t *writes)
{
    *size = HOST_FLASH_SIZE;
    *writes = host->flash.writes;
    return host->flash.cells.bytes;
}

const uint8_t *host_cells(const struct host_device *host, size_t *size)
{
    *size = sizeof host->flash.cells;
    return (const uint8_t *)&host->flash.cells;
}

void host_reset(struct host_device *host)
{
    boot(host, WIRE_RESET_CAUSE_PIN);
}

uint8_t *host_kept_memory(struct host_device *host, size_t *size)
{
    *size = sizeof host->fault_log;
    return (uint8_t *)&host->fault_log;
}

void host_cut_power_after(struct host_device *host, uint64_t bytes)
{
    host->flash.power_limited = true;
    host->flash.power_left = bytes;
}

void host_inject(struct host_device *host, uint32_t fault, uint32_t axis)
{
    if (fault == WIRE_FAULT_NONE || fault >= WIRE_FAULT_COUNT || axis >= AXES)
        return;
    if (fault == WIRE_FAULT_ADC_RAIL) {
        host->rail_axis = axis;
        host->rail_ticks = INJECTED_RAIL_TICKS;
    } else if (fault == WIRE_FAULT_CORE_LOST) {
        boot(host, WIRE_RESET_CAUSE_WATCHDOG);
    } else {
        if (fault == WIRE_FAULT_INTERLOCK)
            device_input(&host->device);
        device_raise(&host->device, (enum wire_fault)fault, axis, 0);
    }
}
