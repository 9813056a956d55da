/* The independent watchdog, on its own oscillator of 32 kHz, 17 to 47 by the data sheet: about 8 ms, 15 at its slowest,
 * while the device runs; 4.1 s, 2.8 at its fastest, from the bootloader until then. The longest start, which waits 1 s
 * for the supply, is shorter. */
#ifndef PHASELEAD_STM32F4_WATCHDOG_H
#define PHASELEAD_STM32F4_WATCHDOG_H

#include "port/stm32f4/registers.h"

#define WATCHDOG_FAST 0u /* a quarter of the oscillator */
#define WATCHDOG_FAST_RELOAD 63u
#define WATCHDOG_SLOW 3u /* a 32nd */
#define WATCHDOG_SLOW_RELOAD 0xFFFu
/* A new reload counts five cycles of that oscillator after it has started (RM0090, 21.4.4; at most 40 us and 294 us);
 * to feed it before would load the 0.5 s that it had. A turn is at least 4 cycles. */
#define WATCHDOG_TURNS 40000u

static inline void watchdog_start(uint32_t divider, uint32_t reload)
{
    IWDG->KR = IWDG_START;
    IWDG->KR = IWDG_UNLOCK;
    IWDG->PR = divider;
    IWDG->RLR = reload;
    for (uint32_t turns = WATCHDOG_TURNS; turns > 0 && (IWDG->SR & IWDG_SR_UPDATING) != 0; turns--)
        ;
    IWDG->KR = IWDG_FEED;
}

static inline void watchdog_feed(void)
{
    IWDG->KR = IWDG_FEED;
}

#endif
