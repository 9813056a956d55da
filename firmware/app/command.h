/* What each command does. A handler gets a request of the right length, in a state that its row in commands.c allows.
 */
#ifndef PHASELEAD_APP_COMMAND_H
#define PHASELEAD_APP_COMMAND_H

#include "app/device.h"

struct request {
    const struct wire_header *header;
    const uint8_t *payload;
    size_t size;
};

/* The reply under construction: status, what follows it, and the size of that. The frame's tick is set by the
 * service. */
struct answer {
    uint8_t *payload; /* WIRE_MAX_PAYLOAD bytes, zero up to the fixed size of the reply */
    uint64_t tick;    /* before which the command took effect */
    size_t size;
};

typedef enum wire_status command_handler(struct device *device, const struct request *request, struct answer *answer);

command_handler command_hello, command_stop, command_status, command_arm, command_start, command_park,
    command_clear_fault, command_set_timeout, command_info;
command_handler command_set_axis, command_set_path, command_wave_chunk, command_wave_commit;
command_handler command_model_begin, command_model_chunk, command_model_commit, command_model_read,
    command_model_persist;
command_handler command_stream_start, command_stream_stop, command_snapshot_read;

#endif
