/* The recorder where ticks do not come. Prints of each batch its first tick, ticks taken and ticks dropped before; at
 * the end all ticks that were dropped. Usage: lost_ticks DECIMATION [RUN LOST]... */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "app/recorder.h"

static struct recorder recorder;

static void print_batches(void)
{
    size_t size;
    for (const struct recorder_batch *batch; (batch = recorder_next(&recorder, &size)) != NULL;) {
        printf("%" PRIu64 " %" PRIu32 " %" PRIu32 "\n", batch->first_tick, batch->size / recorder.format.tick_size,
               batch->dropped);
        recorder_release(&recorder);
    }
}

int main(int count, char **arguments)
{
    struct recorder_format format;
    if (count < 2 || !recorder_format(&format, WIRE_CHANNEL_DAC, 1, (uint16_t)strtoul(arguments[1], NULL, 10)))
        return 2;
    recorder_start(&recorder, &format);
    uint64_t tick = 0;
    for (int i = 2; i + 1 < count; i += 2) {
        static const uint16_t ADC_CODES[RECORDER_AXES];
        static const struct axis_trace TRACES[RECORDER_AXES];
        for (unsigned long left = strtoul(arguments[i], NULL, 10); left > 0; left--) {
            recorder_tick(&recorder, tick++, ADC_CODES, TRACES);
            print_batches();
        }
        const uint32_t lost = (uint32_t)strtoul(arguments[i + 1], NULL, 10);
        recorder_miss(&recorder, lost);
        tick += lost;
    }
    recorder_stop(&recorder);
    print_batches();
    printf("%" PRIu64 "\n", recorder.dropped);
    return 0;
}
