/* STREAM_START while ticks come in between. Prints its status; ticks that came; whether the state was latched, is that
 * of the reply's tick, and is streamed from. Usage: stream_start TICKS, each in one of the moments in which ticks may.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app/command.h"
#include "app/device_init.h"
#include "app/device_tick.h"
#include "port/host/flash.h"

static struct device device;
static struct host_flash flash;
static struct fault_log fault_log;
static unsigned left;

static void tick_first(void *context)
{
    static const uint16_t ADC_CODES[AXES] = {20000, 20000, 20000};
    uint16_t dac_codes[AXES];
    (void)context;
    if (left == 0)
        return;
    left--;
    device_tick(&device, ADC_CODES, dac_codes);
}

int main(int count, char **arguments)
{
    if (count != 2 || !host_flash_init(&flash, NULL, 0))
        return 2;
    struct device_port port = {.flash = host_flash_models(&flash),
                               .records = host_flash_journal(&flash),
                               .fault_log = &fault_log,
                               .lock = tick_first,
                               .baud = 2000000,
                               .target = "host"};
    device_init(&device, &port);
    device.latched_valid = true; /* of a stream before */
    left = (unsigned)strtoul(arguments[1], NULL, 10);

    const struct wire_stream_start_request start = {.channels = WIRE_CHANNEL_DAC, .axis_mask = 1, .decimation = 1};
    uint8_t payload[WIRE_MAX_PAYLOAD], reply[WIRE_MAX_PAYLOAD];
    wire_pack_stream_start_request(&start, payload, sizeof payload);
    struct request request = {.payload = payload, .size = WIRE_STREAM_START_REQUEST_SIZE};
    struct answer answer = {.payload = reply};
    enum wire_status status = command_stream_start(&device, &request, &answer);
    printf("%d %" PRIu64 " %d %d %d\n", status, device.control.tick, device.latched_valid,
           answer.tick == device.control.tick && memcmp(&device.latched, &device.control, sizeof device.latched) == 0,
           device.recorder.recording);
    return 0;
}
