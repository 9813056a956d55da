/* What a device does on an event and on a fault, by the supervisor's tables. */
#ifndef PHASELEAD_APP_REACTION_H
#define PHASELEAD_APP_REACTION_H

#include "app/device.h"

/* Posts an event to the supervisor and does what its table says. Returns ok, wrong_state or fault_latched. */
enum wire_status device_event(struct device *device, enum supervisor_event event, uint8_t axis_mask);

/* Latches a fault and begins its reaction. */
void device_fault(struct device *device, enum wire_fault fault, unsigned axis, uint32_t detail);

/* For ports, from any context: this fault was detected; the next tick reacts to it. */
void device_raise(struct device *device, enum wire_fault fault, unsigned axis, uint32_t detail);

/* In the tick: reacts to the faults that were raised. The first to be raised is the one that is latched. */
void device_take_raised(struct device *device);

#endif
