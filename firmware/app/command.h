/* What each command does. A handler gets a request of the right length, in a state that the schema allows. */
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

/* command_NAME() for every command of the schema: each is defined in one of the files commands_*.c. */
#define DECLARE(name, number, states, locks_itself) command_handler command_##name;
WIRE_COMMANDS(DECLARE)
#undef DECLARE

#endif
