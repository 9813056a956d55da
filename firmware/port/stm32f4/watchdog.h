/* The independent watchdog: about 8 ms on its own oscillator, 15 ms when that runs at its slowest (17 kHz). */
#ifndef PHASELEAD_STM32F4_WATCHDOG_H
#define PHASELEAD_STM32F4_WATCHDOG_H

#include "port/stm32f4/registers.h"

#define WATCHDOG_RELOAD 63u /* of a quarter of 32 kHz */

static inline void watchdog_start(void)
{
    IWDG->KR = IWDG_START;
    IWDG->KR = IWDG_UNLOCK;
    IWDG->PR = 0;
    IWDG->RLR = WATCHDOG_RELOAD;
    IWDG->KR = IWDG_FEED;
}

static inline void watchdog_feed(void)
{
    IWDG->KR = IWDG_FEED;
}

#endif
