/* QUEUE while a fault comes. Prints its status, whether the fault came, and how many paths are queued then. Usage:
 * queue_fault MOMENT, counted in locks that the command takes */
#include <stdio.h>
#include <stdlib.h>

#include "app/command.h"
#include "app/device_init.h"
#include "app/device_tick.h"
#include "app/reaction.h"
#include "port/host/flash.h"

static struct device device;
static struct host_flash flash;
static struct fault_log fault_log;
static unsigned long until;

static void tick(void)
{
    static const uint16_t ADC_CODES[AXES] = {20000, 20000, 20000};
    uint16_t dac_codes[AXES];
    device_tick(&device, ADC_CODES, dac_codes);
}

static void fault_first(void *context)
{
    (void)context;
    if (until == 0)
        return;
    until--;
    if (until > 0)
        return;
    device_raise(&device, WIRE_FAULT_INTERLOCK, NO_AXIS, 0);
    tick();
}

static enum wire_status run(command_handler *handler, size_t size, uint8_t payload[WIRE_MAX_PAYLOAD])
{
    static uint8_t reply[WIRE_MAX_PAYLOAD];
    struct request request = {.payload = payload, .size = size};
    struct answer answer = {.payload = reply};
    return handler(&device, &request, &answer);
}

static bool begin_to_hold(void)
{
    uint8_t payload[WIRE_MAX_PAYLOAD] = {0};
    const struct wire_set_axis_request axis = {.mode = AXIS_OPEN, .d_alpha_q31 = INT32_MAX};
    wire_pack_set_axis_request(&axis, payload, sizeof payload);
    bool done = run(command_set_axis, WIRE_SET_AXIS_REQUEST_SIZE, payload) == WIRE_STATUS_OK;
    const struct wire_set_path_request path = {.path = PATH_HOLD};
    wire_pack_set_path_request(&path, payload, sizeof payload);
    done = done && run(command_set_path, WIRE_SET_PATH_REQUEST_SIZE, payload) == WIRE_STATUS_OK;
    const struct wire_arm_request arm = {0};
    wire_pack_arm_request(&arm, payload, sizeof payload);
    done = done && run(command_arm, WIRE_ARM_REQUEST_SIZE, payload) == WIRE_STATUS_OK;
    const struct wire_start_request start = {.axis_mask = 1};
    wire_pack_start_request(&start, payload, sizeof payload);
    done = done && run(command_start, WIRE_START_REQUEST_SIZE, payload) == WIRE_STATUS_OK;
    tick();
    return done;
}

int main(int count, char **arguments)
{
    if (count != 2 || !host_flash_init(&flash, NULL, 0))
        return 2;
    struct device_port port = {.flash = host_flash_models(&flash),
                               .records = host_flash_journal(&flash),
                               .fault_log = &fault_log,
                               .lock = fault_first,
                               .target = "host"};
    device_init(&device, &port);
    if (!begin_to_hold())
        return 1;
    until = strtoul(arguments[1], NULL, 10);
    uint8_t payload[WIRE_MAX_PAYLOAD];
    const struct wire_queue_request queue = {.axis_mask = 1, .segments = {{.path = PATH_HOLD}}};
    wire_pack_queue_request(&queue, payload, sizeof payload);
    const enum wire_status status = run(command_queue, WIRE_QUEUE_REQUEST_SIZE, payload);
    printf("%d %d %u\n", status, device.control.state == WIRE_STATE_FAULT, (unsigned)device.control.queue[0].count);
    return 0;
}
