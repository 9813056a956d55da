/* One path after another: what a device does between two ticks with the queues of its axes (core/segment.h). */
#ifndef PHASELEAD_APP_MOTION_H
#define PHASELEAD_APP_MOTION_H

#include "app/device.h"

/* Paths that have ended give way to the next of their queue, or to a hold. */
void motion_move_on(struct device *device);

/* Empties the queues of these axes. */
void motion_drop(struct device *device, uint32_t mask);

#endif
