/* The line: frames in, commands done, frames out. */
#ifndef PHASELEAD_APP_SERVICE_H
#define PHASELEAD_APP_SERVICE_H

#include "app/device.h"

/* Takes bytes from the line and executes the commands among them. Returns how many it took: it stops after a command
 * until the reply is on its way; offer the rest again. */
size_t service_receive(struct device *device, const uint8_t *bytes, size_t size);

/* The bytes to be sent next and their number; NULL when there are none. They stay in place until service_sent() has
 * confirmed all of them. */
const uint8_t *service_outgoing(struct device *device, size_t *size);
void service_sent(struct device *device, size_t size);

#endif
