/* A long life of a device: soak random SEED TICKS, or soak day HOURS. Prints what was seen; ends with a message and
 * SIGABRT where an invariant broke. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "day.h"
#include "random_host.h"

static void random_life(uint64_t seed, uint64_t ticks)
{
    static struct random_host host;
    random_host_begin(&host, seed, NULL, 0);
    while (host.ticks < ticks)
        random_host_round(&host);
    printf("{\"ticks\": %" PRIu64 ", \"frames\": %" PRIu64 ", \"replies\": %" PRIu64 ", \"ok\": %" PRIu64, host.ticks,
           host.frames, host.replies, host.ok_replies);
    printf(", \"path_ticks\": %" PRIu64 ", \"inverse_ticks\": %" PRIu64, host.path_ticks, host.inverse_ticks);
    printf(", \"faults\": %" PRIu64 ", \"longest_way_home\": %" PRIu64, host.seen.faults, host.seen.longest_way_home);
    printf(", \"ticks_in\": [");
    for (unsigned i = 0; i < WIRE_STATE_COUNT; i++)
        printf("%s%" PRIu64, i ? ", " : "", host.ticks_in[i]);
    printf("], \"faults_of\": [");
    for (unsigned i = 0; i < WIRE_FAULT_COUNT; i++)
        printf("%s%" PRIu64, i ? ", " : "", host.faults_of[i]);
    printf("]}\n");
}

int main(int count, char **arguments)
{
    if (count == 4 && strcmp(arguments[1], "random") == 0)
        random_life(strtoull(arguments[2], NULL, 10), strtoull(arguments[3], NULL, 10));
    else if (count == 3 && strcmp(arguments[1], "day") == 0)
        day_run(strtod(arguments[2], NULL));
    else {
        fprintf(stderr, "usage: soak random SEED TICKS | soak day HOURS\n");
        return 2;
    }
    return 0;
}
