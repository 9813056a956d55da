#include "port/stm32f4/core_lost.h"

#include "port/stm32f4/board.h"

#define MAGIC 0x4C4F5354u
#define GUARD_LOG2_BYTES 8u
#define STACKED_PC 6u

/* Exceptions 3 to 6, in the same order as their names on the wire: a table of names would lie in flash. */
#define HARD_FAULT 3u
_Static_assert(WIRE_CORE_LOSS_USAGE_FAULT - WIRE_CORE_LOSS_HARD_FAULT == 3, "faults have lost their order");

struct last_loss {
    uint32_t magic, detail, inverse;
};

/* Linker script. */
extern uint32_t stack_guard_start[], stack_bottom[], stack_top[];

static struct last_loss last_loss __attribute__((section(".kept")));

/* For the handlers: the main stack may be what is broken. */
uint64_t fault_stack[32] __attribute__((used));

RAM_CODE _Noreturn void core_lost(enum wire_core_loss loss, uint32_t address)
{
    GPIOC->BSRR = BIT(PIN_DAC_CLEAR + 16u);
    uint32_t detail = CORE_LOST_DETAIL(loss, address);
    last_loss.magic = MAGIC;
    last_loss.detail = detail;
    last_loss.inverse = ~detail;
    __asm volatile("dsb");
    SCB->AIRCR = SCB_AIRCR_RESET;
    for (;;)
        ;
}

RAM_CODE __attribute__((used)) static _Noreturn void name_fault(const uint32_t *frame)
{
    uint32_t exception = SCB->ICSR & SCB_ICSR_VECTACTIVE, cfsr = SCB->CFSR, at = SCB->MMFAR;
    enum wire_core_loss loss = (enum wire_core_loss)(exception - HARD_FAULT + WIRE_CORE_LOSS_HARD_FAULT);
    if (exception == HARD_FAULT && cfsr != 0) /* met in the tick, which no fault may interrupt by its own name */
        loss = (cfsr & SCB_CFSR_USAGE) != 0 ? WIRE_CORE_LOSS_USAGE_FAULT
               : (cfsr & SCB_CFSR_BUS) != 0 ? WIRE_CORE_LOSS_BUS_FAULT
                                            : WIRE_CORE_LOSS_MEMORY_FAULT;
    uint32_t guard = (uint32_t)stack_guard_start;
    int in_guard = (cfsr & SCB_CFSR_MMARVALID) != 0 && at - guard < 1u << GUARD_LOG2_BYTES;
    if ((cfsr & SCB_CFSR_MSTKERR) != 0 || in_guard || frame < stack_bottom) /* a large frame steps over the guard */
        loss = WIRE_CORE_LOSS_STACK_OVERFLOW;
    int readable = frame >= stack_bottom && frame + 8 <= stack_top;
    core_lost(loss, readable ? frame[STACKED_PC] : 0);
}

RAM_CODE __attribute__((naked)) void core_lost_on_fault(void)
{
    __asm volatile("mov r0, sp\n"
                   "ldr sp, =fault_stack + 256\n"
                   "b name_fault\n");
}

RAM_CODE void core_lost_on_nmi(void)
{
    core_lost(WIRE_CORE_LOSS_CLOCK_STOPPED, 0);
}

RAM_CODE void core_lost_on_stray(void)
{
    core_lost(WIRE_CORE_LOSS_STRAY_INTERRUPT, SCB->ICSR & SCB_ICSR_VECTACTIVE);
}

RAM_CODE void core_lost_on_supply(void)
{
    core_lost(WIRE_CORE_LOSS_SUPPLY_LOW, 0);
}

uint32_t core_lost_take(void)
{
    uint32_t detail = last_loss.detail;
    if (last_loss.magic != MAGIC || last_loss.inverse != ~detail)
        detail = 0;
    last_loss.magic = 0;
    return detail;
}

void core_lost_arm(void)
{
    MPU->RNR = 0;
    MPU->RBAR = (uint32_t)stack_guard_start;
    MPU->RASR = MPU_RASR_XN | MPU_RASR_NO_ACCESS | MPU_RASR_SIZE(GUARD_LOG2_BYTES) | MPU_RASR_ENABLE;
    MPU->CTRL = MPU_CTRL_PRIVDEFENA | MPU_CTRL_ENABLE;
    SCB->SHCSR |= SCB_SHCSR_FAULTS;
    SCB->CCR |= SCB_CCR_DIV0;
    __asm volatile("dsb\n isb");
}
