#include "app/commands.h"

#define PARKED (1u << WIRE_STATE_PARKED)
#define ARMED (1u << WIRE_STATE_ARMED)
#define ANY ((1u << WIRE_STATE_COUNT) - 1)
#define LOCKS_ITSELF true

/* Commands that the supervisor judges itself are allowed anywhere here: its table answers for them. */
static const struct command COMMANDS[] = {
    [0] = {0},
    [WIRE_HELLO] = {command_hello, ANY, false},
    [WIRE_STOP] = {command_stop, ANY, false},
    [WIRE_STATUS] = {command_status, ANY, false},
    [WIRE_ARM] = {command_arm, ANY, false},
    [WIRE_START] = {command_start, ANY, false},
    [WIRE_PARK] = {command_park, ANY, false},
    [WIRE_CLEAR_FAULT] = {command_clear_fault, ANY, false},
    [WIRE_SET_AXIS] = {command_set_axis, PARKED | ARMED, false},
    [WIRE_SET_PATH] = {command_set_path, PARKED | ARMED, false},
    [WIRE_WAVE_CHUNK] = {command_wave_chunk, PARKED, LOCKS_ITSELF},
    [WIRE_WAVE_COMMIT] = {command_wave_commit, PARKED, LOCKS_ITSELF},
    [WIRE_MODEL_BEGIN] = {command_model_begin, PARKED, LOCKS_ITSELF},
    [WIRE_MODEL_CHUNK] = {command_model_chunk, PARKED, LOCKS_ITSELF},
    [WIRE_MODEL_COMMIT] = {command_model_commit, PARKED, LOCKS_ITSELF},
    [WIRE_MODEL_READ] = {command_model_read, ANY, LOCKS_ITSELF},
    [WIRE_MODEL_PERSIST] = {command_model_persist, PARKED, LOCKS_ITSELF},
    [WIRE_STREAM_START] = {command_stream_start, ANY, false},
    [WIRE_STREAM_STOP] = {command_stream_stop, ANY, false},
    [WIRE_SNAPSHOT_READ] = {command_snapshot_read, ANY, LOCKS_ITSELF},
    [WIRE_SET_TIMEOUT] = {command_set_timeout, ANY, false},
    [WIRE_INFO] = {command_info, ANY, false},
};

const struct command *command_find(uint8_t type)
{
    return &COMMANDS[type < sizeof COMMANDS / sizeof COMMANDS[0] ? type : 0];
}
