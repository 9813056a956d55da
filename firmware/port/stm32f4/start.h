/* Where the chip begins, and the two vector tables. */
#ifndef PHASELEAD_STM32F4_START_H
#define PHASELEAD_STM32F4_START_H

void start_vectors_in_flash(void);
void start_vectors_in_ram(void); /* with the parked tick instead of the tick */

#endif
