#include "port/stm32f4/supply.h"

#include "port/stm32f4/clock.h"
#include "port/stm32f4/registers.h"

/* Falling 2.76 V at least, rising 2.99 V at most (PVD level 7). */
#define SUPPLY_TURNS 1600000u /* of some 10 cycles at 16 MHz */
#define DETECTOR_TURNS 200u   /* it settles */

bool supply_comes_up(void)
{
    clock_enable(&RCC->APB1ENR, RCC_APB1ENR_PWR);
    PWR->CR |= PWR_CR_PLS_HIGHEST | PWR_CR_PVDE;
    for (uint32_t turns = DETECTOR_TURNS; turns > 0; turns--)
        (void)PWR->CSR;
    for (uint32_t turns = SUPPLY_TURNS; turns > 0; turns--)
        if ((PWR->CSR & PWR_CSR_PVDO) == 0)
            return true;
    return false;
}

void supply_watch(void)
{
    EXTI->RTSR |= EXTI_LINE_PVD; /* its output rises when the supply falls */
    EXTI->IMR |= EXTI_LINE_PVD;
    NVIC->IPR[IRQ_PVD] = 0;
    NVIC->ISER[IRQ_PVD / 32] = BIT(IRQ_PVD % 32);
}

uint32_t supply_brown_out_level(void)
{
    return 3u - FLASH_OPTCR_BOR_LEV(FLASH->OPTCR);
}
