/* The line: a USART with DMA both ways. Reception is one circular buffer that the DMA fills by itself, so no byte waits
 * for the program.
 */
#ifndef PHASELEAD_STM32F4_SERIAL_H
#define PHASELEAD_STM32F4_SERIAL_H

#include "app/device.h"

void serial_set_up(void);

/* Moves what has come to the device and what it says to the line. False when there was nothing to do. It stays a
 * function of its own: tests of the emulated board put faults of the main loop at its entry. */
__attribute__((noinline, noclone)) bool serial_poll(struct device *device);

/* Vector table: only wakes the main loop. */
void serial_sent(void);

#endif
