/* A device as it comes out of reset. */
#ifndef PHASELEAD_APP_DEVICE_INIT_H
#define PHASELEAD_APP_DEVICE_INIT_H

#include "app/device.h"

/* Output at its safe value, the newest model from flash, no session. */
void device_init(struct device *device, const struct device_port *port);

#endif
