/* LIMITS_SET while flash is written and a tick takes a fault. Prints state, and DAC code and highest voltage of the
 * first axis, before and after a second of ticks. Usage: during_write FAULT */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "app/command.h"
#include "app/device_init.h"
#include "app/device_tick.h"
#include "app/reaction.h"
#include "core/fixed.h"
#include "port/host/flash.h"

static struct device device;
static struct host_flash flash;
static struct fault_log fault_log;
static struct flash_port records;
static enum wire_fault fault;

static void tick(void)
{
    static const uint16_t ADC_CODES[AXES] = {20000, 20000, 20000};
    uint16_t dac_codes[AXES];
    device_tick(&device, ADC_CODES, dac_codes);
}

static bool program(void *context, unsigned slot, uint32_t offset, const uint8_t *bytes, size_t size)
{
    bool done = records.program(context, slot, offset, bytes, size);
    if (fault != WIRE_FAULT_NONE)
        device_raise(&device, fault, NO_AXIS, 0);
    tick();
    return done;
}

static void print(void)
{
    printf("%" PRIu32 " %u %" PRId32 "\n", device.control.state, device.dac_codes[0],
           device.control.config[0].output.u_max_q24);
}

int main(int count, char **arguments)
{
    if (count != 2 || !host_flash_init(&flash, NULL, 0))
        return 2;
    fault = (enum wire_fault)strtol(arguments[1], NULL, 10);
    records = host_flash_journal(&flash);
    struct device_port port = {
        .flash = host_flash_models(&flash), .records = records, .fault_log = &fault_log, .target = "host"};
    port.records.program = program;
    device_init(&device, &port);
    device.control.axis[0].u_q24 = 2 << 24; /* held there: parked in mid ramp by STOP */
    device.control.axis[0].drive = DRIVE_HOLD;
    tick();

    struct wire_limits_set_request limits;
    for (unsigned axis = 0; axis < AXES; axis++)
        limits.limits[axis] = (struct wire_axis_limits){
            .dac_min = 32768, .dac_max = 32768 + 5 * 3200, .slew_codes_q16 = UINT32_MAX, .adc_max = UINT16_MAX};
    uint8_t payload[WIRE_MAX_PAYLOAD], reply[WIRE_MAX_PAYLOAD];
    wire_pack_limits_set_request(&limits, payload, sizeof payload);
    struct request request = {.payload = payload, .size = WIRE_LIMITS_SET_REQUEST_SIZE};
    struct answer answer = {.payload = reply};
    if (command_limits_set(&device, &request, &answer) != WIRE_STATUS_OK)
        return 1;
    print();
    for (unsigned i = 0; i < TICK_RATE_HZ; i++)
        tick();
    print();
    return 0;
}
