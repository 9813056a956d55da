/* What the device does with its fault log: what waits there is written when it may be. */
#ifndef PHASELEAD_APP_FAULT_WRITING_H
#define PHASELEAD_APP_FAULT_WRITING_H

#include "app/device.h"

/* For a port's main loop, outside of the tick: writes to the journal what is due, when it may. */
void fault_log_write(struct device *device);

#endif
