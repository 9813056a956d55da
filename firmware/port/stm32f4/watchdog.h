/* The independent watchdog: about 8 ms on its own oscillator, 15 ms when that runs at its slowest (17 kHz). */
#ifndef PHASELEAD_STM32F4_WATCHDOG_H
#define PHASELEAD_STM32F4_WATCHDOG_H

#include "port/stm32f4/registers.h"

#define WATCHDOG_RELOAD 63u /* of a quarter of 32 kHz */
/* A new reload counts five cycles of that oscillator after it has started (RM0090, 21.4.4; at most 40 us and 294 us);
 * to feed it before would load the 0.5 s that it had. A turn is at least 4 cycles. */
#define WATCHDOG_TURNS 40000u

static inline void watchdog_start(void)
{
    IWDG->KR = IWDG_START;
    IWDG->KR = IWDG_UNLOCK;
    IWDG->PR = 0;
    IWDG->RLR = WATCHDOG_RELOAD;
    for (uint32_t turns = WATCHDOG_TURNS; turns > 0 && (IWDG->SR & IWDG_SR_UPDATING) != 0; turns--)
        ;
    IWDG->KR = IWDG_FEED;
}

static inline void watchdog_feed(void)
{
    IWDG->KR = IWDG_FEED;
}

#endif
