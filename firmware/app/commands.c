#include "app/commands.h"

#define ROW(name, number, states, locks_itself) [number] = {command_##name, states, locks_itself},

static const struct command COMMANDS[] = {[0] = {0}, WIRE_COMMANDS(ROW)};

const struct command *command_find(uint8_t type)
{
    return &COMMANDS[type < sizeof COMMANDS / sizeof COMMANDS[0] ? type : 0];
}
