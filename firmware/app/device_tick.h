/* The control tick. */
#ifndef PHASELEAD_APP_DEVICE_TICK_H
#define PHASELEAD_APP_DEVICE_TICK_H

#include "app/device.h"

/* One control tick: codes in, codes out. */
void device_tick(struct device *device, const uint16_t adc_codes[AXES], uint16_t dac_codes[AXES]);

/* Puts the events of paths that have ended: outside the tick, whose worst would have to hold it. */
void device_put_path_events(struct device *device);

/* For ports: so many ticks went by without device_tick(), at rest, because flash was busy. They count, and a stream
 * says that it lacks them. */
void device_miss_ticks(struct device *device, uint32_t ticks);

#endif
