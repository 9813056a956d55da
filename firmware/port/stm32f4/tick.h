/* The control tick: TIM2 at 5 kHz, the highest priority there is. */
#ifndef PHASELEAD_STM32F4_TICK_H
#define PHASELEAD_STM32F4_TICK_H

#include "app/device.h"

/* Starts the ticks of `device`, and its cycle counter. */
void tick_start(struct device *device);

/* From the main loop, again and again: it is alive, and does what need not be done in a tick. */
void tick_between(void);

/* Vector table. */
void tick_interrupt(void);

/* What stands in for a tick while flash is busy: nothing of the control law, which rests; the interlock is watched and
 * the watchdog fed. Counts itself. */
void tick_parked(void);
extern volatile uint32_t tick_parked_count;

/* The port's half of struct device_port: keeps the tick out, lets it in, takes its codes. */
void tick_lock(void *context);
void tick_unlock(void *context);
void tick_drive(void *context, const uint16_t dac_codes[AXES]);

#endif
