/* The end of the road: the program can no longer be trusted. The converter is cleared to 0 V by its own pin, the cause
 * is left in memory that survives a reset, and the chip is reset.
 */
#ifndef PHASELEAD_STM32F4_CORE_LOST_H
#define PHASELEAD_STM32F4_CORE_LOST_H

#include <stdint.h>

#include "app/wire.h"

/* What is left behind: enum wire_core_loss in the top four bits, below them the address at which it happened. */
#define CORE_LOST_DETAIL(loss, address) ((uint32_t)(loss) << 28 | ((address) & 0x0FFFFFFFu))

_Noreturn void core_lost(enum wire_core_loss loss, uint32_t address);

/* Entries of the vector table. */
void core_lost_on_fault(void);
void core_lost_on_nmi(void);
void core_lost_on_stray(void);
void core_lost_on_supply(void);

/* Takes the detail that the last core_lost() left, 0 when there is none. */
uint32_t core_lost_take(void);

/* No access below the stack, and faults of their own for what else goes wrong. */
void core_lost_arm(void);

#endif
