#include "port/stm32f4/clock.h"

#include <stdbool.h>

#include "port/stm32f4/board.h"

/* A turn of the wait is about 8 cycles of the 16 MHz that the chip starts with. */
#define CRYSTAL_TURNS 20000u
#define PLL_TURNS 2000u

/* 2 MHz into the PLL, 336 MHz out of its oscillator, halved. Q and R keep their unused outputs within their limits. */
#define PLL_HSE_M 4u
#define PLL_HSI_M 8u
#define PLL_N 168u

static bool wait_for(const volatile uint32_t *reg, uint32_t mask, uint32_t value, uint32_t turns)
{
    while ((*reg & mask) != value)
        if (turns-- == 0)
            return false;
    return true;
}

static bool start_pll(uint32_t m, uint32_t source)
{
    RCC->PLLCFGR =
        RCC_PLLCFGR_M(m) | RCC_PLLCFGR_N(PLL_N) | RCC_PLLCFGR_P2 | source | RCC_PLLCFGR_Q(7u) | RCC_PLLCFGR_R(2u);
    RCC->CR |= RCC_CR_PLLON;
    if (!wait_for(&RCC->CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY, PLL_TURNS))
        return false;
    /* RM0090, 3.5.1: the wait states are in force when they read back; then the buses' dividers, then the clock. */
    FLASH->ACR = FLASH_ACR_5_WAITS | FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN;
    if (!wait_for(&FLASH->ACR, FLASH_ACR_WAITS_MASK, FLASH_ACR_5_WAITS, PLL_TURNS))
        return false;
    RCC->CFGR = RCC_CFGR_APB1_DIV4 | RCC_CFGR_APB2_DIV2;
    (void)RCC->CFGR;
    RCC->CFGR = RCC_CFGR_APB1_DIV4 | RCC_CFGR_APB2_DIV2 | RCC_CFGR_SW_PLL;
    return wait_for(&RCC->CFGR, RCC_CFGR_SWS_MASK, RCC_CFGR_SWS_PLL, PLL_TURNS);
}

/* ES0182, 2.1.13 (F405) and ES0298 (F446): a peripheral misses what is written to it in the first 1 + AHB/APB cycles. A
 * barrier is the workaround that was measured to help on an F407, reading back is not (community.st.com, 579949); the
 * reads take the 5 cycles as well. */
void clock_enable(volatile uint32_t *enable, uint32_t bits)
{
    *enable |= bits;
    __asm volatile("dsb" ::: "memory");
    for (unsigned reads = 0; reads < 4; reads++)
        (void)*enable;
}

enum clock_source clock_start(void)
{
    clock_enable(&RCC->APB1ENR, RCC_APB1ENR_PWR);
    PWR->CR |= PWR_CR_VOS_SCALE1;
    if (BOARD_HSE_BYPASS)
        RCC->CR |= RCC_CR_HSEBYP;
    RCC->CR |= RCC_CR_HSEON;
    bool crystal = wait_for(&RCC->CR, RCC_CR_HSERDY, RCC_CR_HSERDY, CRYSTAL_TURNS);
    if (!crystal)
        RCC->CR &= ~RCC_CR_HSEON;
    if (!start_pll(crystal ? PLL_HSE_M : PLL_HSI_M, crystal ? RCC_PLLCFGR_HSE : 0u))
        return CLOCK_SLOW;
    if (crystal)
        RCC->CR |= RCC_CR_CSSON;
    return crystal ? CLOCK_CRYSTAL : CLOCK_INTERNAL;
}
