/* What the three axes of a device do in a tick: each block of core/axis.h for all axes that move. */
#ifndef PHASELEAD_APP_AXES_H
#define PHASELEAD_APP_AXES_H

#include "app/device.h"

/* Axes whose output can change: those that do not rest. */
uint32_t axes_moving(const struct device *device);

/* Reference, look-ahead and feed-forward of the next tick, for the axes that follow a path. Called after the output of
 * every tick. */
void axes_set_targets(struct device *device);

/* Errors of the axes under feedback, those of inverses decoupled; 0 for the others. */
void axes_find_errors(struct device *device, uint32_t moving, int32_t error_q16[AXES]);

/* Feedback, limits and DAC codes. */
void axes_step(struct device *device, uint32_t moving, const int32_t error_q16[AXES]);

/* After the output: which axes are where they should be. */
void axes_watch_targets(struct device *device, uint32_t moving);

/* After the output: lets the memory of the inverses follow it. */
void axes_follow_outputs(struct device *device, uint32_t moving);

/* The axes of the mask begin their paths with the tick after next: the next one still holds, and works out with what.
 * That takes too long for a command, which keeps ticks out. */
void axes_start(struct device *device, uint8_t axis_mask);

/* After that, still between the same two ticks: from their first target on these axes are decoupled from each other, so
 * the join of an inverse is to begin with what is seen of all their motions. What is seen of an axis without an inverse
 * is known. */
void axes_couple_joins(struct device *device, uint8_t axis_mask);

/* How long after a start the paths of these axes begin: those that are entered by a join. */
uint32_t axes_enter_ticks(const struct device *device, uint32_t mask);

/* All axes leave their paths, to hold or to ramp to their safe value. */
void axes_leave_paths(struct device *device, enum axis_drive drive);

#endif
