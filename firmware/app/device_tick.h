/* The control tick. */
#ifndef PHASELEAD_APP_DEVICE_TICK_H
#define PHASELEAD_APP_DEVICE_TICK_H

#include "app/device.h"

/* One control tick: codes in, codes out. Before it a port lets those trigger outputs pulse that control.pulsing has. */
void device_tick(struct device *device, const uint16_t adc_codes[AXES], uint16_t dac_codes[AXES]);

/* For ports, before a tick: the input that may trigger the transient recorder, the interlock, is open. */
void device_input(struct device *device);

/* For ports, before a tick: a rising edge has come at the trigger input since the tick before. */
void device_trigger_edge(struct device *device);

/* Queues the events of paths that have ended. Called outside the tick, so that its worst case does not include it. */
void device_put_path_events(struct device *device);

/* For ports: this many ticks passed without device_tick(), at rest, because flash was busy. They are counted, and a
 * stream reports them as dropped. */
void device_miss_ticks(struct device *device, uint32_t ticks);

/* For ports, at the beginning of a tick: this many before it did not come although they should have. They are counted
 * as well, and a fault. */
void device_lose_ticks(struct device *device, uint32_t ticks);

#endif
