/* The table of commands. */
#ifndef PHASELEAD_APP_COMMANDS_H
#define PHASELEAD_APP_COMMANDS_H

#include "app/command.h"

struct command {
    command_handler *handler; /* NULL: no such command */
    uint8_t states;           /* mask of enum wire_state it is allowed in */
    bool locks_itself;        /* it is slow: the tick runs on meanwhile */
};

/* Never NULL; for a number that is no command, one without a handler. */
const struct command *command_find(uint8_t type);

#endif
