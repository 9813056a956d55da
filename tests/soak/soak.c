/* A long life of a device: soak random SEED TICKS, or soak day HOURS. Prints what was seen; ends with a message and
 * SIGABRT where an invariant broke. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "day.h"
#include "random_host.h"

static void print_counts(const char *name, const uint64_t *counts, unsigned size)
{
    printf(", \"%s\": [", name);
    for (unsigned i = 0; i < size; i++)
        printf("%s%" PRIu64, i ? ", " : "", counts[i]);
    printf("]");
}

static void random_life(uint64_t seed, uint64_t ticks)
{
    static struct random_host host;
    random_host_begin(&host, seed, NULL, 0);
    while (host.ticks < ticks)
        random_host_round(&host);
    printf("{\"ticks\": %" PRIu64 ", \"frames\": %" PRIu64 ", \"replies\": %" PRIu64, host.ticks, host.frames,
           host.replies);
    printf(", \"faults\": %" PRIu64 ", \"longest_way_home\": %" PRIu64, host.seen.faults, host.seen.longest_way_home);
    printf(", \"gains_under_way\": %" PRIu64, host.gains_under_way);
    print_counts("done_of", host.done_of, WIRE_REPLY_BIT);
    print_counts("ticks_in", host.ticks_in, WIRE_STATE_COUNT);
    print_counts("faults_of", host.faults_of, WIRE_FAULT_COUNT);
    print_counts("path_ticks_in", host.path_ticks_in, WIRE_MODE_COUNT);
    print_counts("filter_ticks", host.filter_ticks, 1u << LOOP_SECTIONS);
    printf("}\n");
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
