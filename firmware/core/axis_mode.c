#include "core/axis_mode.h"

bool axis_mode_has_feedback(uint32_t mode)
{
    return mode == AXIS_PID || mode == AXIS_FF_PID || mode == AXIS_INVERSE_PID;
}

bool axis_mode_inverts(uint32_t mode)
{
    return mode == AXIS_INVERSE || mode == AXIS_INVERSE_PID;
}

bool axis_mode_uses_tables(uint32_t mode)
{
    return mode == AXIS_FF || mode == AXIS_FF_PID;
}
