/* The line: frames in, commands done, frames out. */
#ifndef PHASELEAD_APP_SERVICE_H
#define PHASELEAD_APP_SERVICE_H

#include "app/device.h"

/* Takes bytes from the line and does the commands among them. Returns how many it took: it stops behind a command
 * until that one's reply is on its way; offer the rest again. */
size_t service_receive(struct device *device, const uint8_t *bytes, size_t size);

/* What is to be sent next and how much of it; NULL when there is nothing. It stays where it is until service_sent()
 * has been told of all of it. */
const uint8_t *service_outgoing(struct device *device, size_t *size);
void service_sent(struct device *device, size_t size);

#endif
