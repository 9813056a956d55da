/* The supply. Below 2.7 V flash is too slow for 168 MHz (data sheets of F405 and F446, flash wait states), and chips
 * are delivered with their brown-out reset switched off: the voltage detector at its highest threshold stands in for
 * it.
 */
#ifndef PHASELEAD_STM32F4_SUPPLY_H
#define PHASELEAD_STM32F4_SUPPLY_H

#include <stdbool.h>
#include <stdint.h>

/* Before the clock is raised: waits, for a second at most, until the supply is above the threshold. False: it is not.
 */
bool supply_comes_up(void);

/* From now on a supply that falls below the threshold ends the program: core_lost_on_supply(). */
void supply_watch(void);

/* Level of the brown-out reset in the option bytes: 0 off, 3 the highest. */
uint32_t supply_brown_out_level(void);

#endif
