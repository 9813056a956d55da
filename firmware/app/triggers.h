/* The trigger outputs of a device. */
#ifndef PHASELEAD_APP_TRIGGERS_H
#define PHASELEAD_APP_TRIGGERS_H

#include "app/device.h"

/* After the targets of the next tick: which outputs pulse in it. */
void triggers_set_outputs(struct device *device);

#endif
