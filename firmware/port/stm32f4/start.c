#include "port/stm32f4/start.h"

#include <stdint.h>

#include "port/stm32f4/core_lost.h"
#include "port/stm32f4/registers.h"
#include "port/stm32f4/serial.h"
#include "port/stm32f4/tick.h"

#define EXCEPTIONS 16

typedef void handler(void);

struct vectors {
    uint32_t *stack;
    handler *exceptions[EXCEPTIONS - 1];
    handler *irqs[IRQ_COUNT];
};

/* Linker script. */
extern uint32_t stack_top[], data_from[], data_start[], data_end[], zeroed_start[], zeroed_end[];

int main(void);
/* What the bootloader calls: `on_trial` is 1 or 0. */
_Noreturn void start(uint32_t on_trial);

/* Whatever no driver asked for means that the program is lost. */
#define STRAY core_lost_on_stray
static const struct vectors flash_vectors __attribute__((section(".vectors"), used)) = {
    .stack = stack_top,
    .exceptions = {(handler *)start, core_lost_on_nmi, core_lost_on_fault, core_lost_on_fault, core_lost_on_fault,
                   core_lost_on_fault, STRAY, STRAY, STRAY, STRAY, STRAY, STRAY, STRAY, STRAY, STRAY},
    .irqs = {[0 ... IRQ_PVD - 1] = STRAY,
             [IRQ_PVD] = core_lost_on_supply,
             [IRQ_PVD + 1 ... IRQ_DMA1_STREAM6 - 1] = STRAY,
             [IRQ_DMA1_STREAM6] = serial_sent,
             [IRQ_DMA1_STREAM6 + 1 ... IRQ_TIM2 - 1] = STRAY,
             [IRQ_TIM2] = tick_interrupt,
             [IRQ_TIM2 + 1 ... IRQ_DMA2_STREAM7 - 1] = STRAY,
             [IRQ_DMA2_STREAM7] = serial_sent,
             [IRQ_DMA2_STREAM7 + 1 ... IRQ_COUNT - 1] = STRAY},
};

static bool was_a_trial;
static struct vectors ram_vectors __attribute__((aligned(512)));

static void use(const struct vectors *vectors)
{
    SCB->VTOR = (uint32_t)vectors;
    __asm volatile("dsb\n isb");
}

void start_vectors_in_flash(void)
{
    use(&flash_vectors);
}

void start_vectors_in_ram(void)
{
    ram_vectors = flash_vectors;
    ram_vectors.irqs[IRQ_TIM2] = tick_parked;
    use(&ram_vectors);
}

bool start_was_a_trial(void)
{
    return was_a_trial;
}

_Noreturn void start_again(void)
{
    __asm volatile("dsb");
    SCB->AIRCR = SCB_AIRCR_RESET;
    for (;;)
        ;
}

_Noreturn void start(uint32_t on_trial)
{
    const uint32_t *from = data_from;
    for (uint32_t *to = data_start; to < data_end; to++)
        *to = *from++;
    for (uint32_t *to = zeroed_start; to < zeroed_end; to++)
        *to = 0;
    was_a_trial = on_trial == 1;
    start_vectors_in_flash();
    main();
    core_lost(WIRE_CORE_LOSS_STRAY_INTERRUPT, 0);
}
