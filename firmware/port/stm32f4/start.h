/* Where the image begins, and its two vector tables. */
#ifndef PHASELEAD_STM32F4_START_H
#define PHASELEAD_STM32F4_START_H

#include <stdbool.h>

void start_vectors_in_flash(void);
void start_vectors_in_ram(void); /* with the parked tick instead of the tick */

/* What the bootloader said: it is the image on trial. */
bool start_was_a_trial(void);

/* Resets the chip, of the program's own will. */
_Noreturn void start_again(void);

#endif
