/* The modes of an axis, and what is at work in each. */
#ifndef PHASELEAD_CORE_AXIS_MODE_H
#define PHASELEAD_CORE_AXIS_MODE_H

#include <stdbool.h>
#include <stdint.h>

enum axis_mode { AXIS_IDLE, AXIS_OPEN, AXIS_PID, AXIS_FF, AXIS_FF_PID, AXIS_INVERSE, AXIS_INVERSE_PID };

bool axis_mode_has_feedback(uint32_t mode);
bool axis_mode_inverts(uint32_t mode);
bool axis_mode_uses_tables(uint32_t mode);

#endif
