/* 168 MHz from the crystal, or from the internal oscillator when there is none. */
#ifndef PHASELEAD_STM32F4_CLOCK_H
#define PHASELEAD_STM32F4_CLOCK_H

#include <stdint.h>

enum clock_source {
    CLOCK_CRYSTAL,
    CLOCK_INTERNAL, /* 168 MHz within 1 %: the tick rate is off by as much */
    CLOCK_SLOW      /* not even the PLL started: 16 MHz, too slow for a tick */
};

/* Waits are bounded: 10 ms for the crystal, 1 ms for the PLL. From CLOCK_CRYSTAL on, a crystal that stops raises NMI.
 */
enum clock_source clock_start(void);

/* Sets bits of an enable register of the RCC and returns when the peripherals listen. */
void clock_enable(volatile uint32_t *enable, uint32_t bits);

#endif
