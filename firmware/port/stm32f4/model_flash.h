/* The two model slots, flash sectors 6 and 7, and the journal, sectors 2 and 3. The chip cannot fetch from flash while
 * it erases or programs, for 1 to 2 s an erase, so meanwhile everything that runs is in RAM: the loop that waits, the
 * vectors, the parked tick.
 */
#ifndef PHASELEAD_STM32F4_MODEL_FLASH_H
#define PHASELEAD_STM32F4_MODEL_FLASH_H

#include "app/device.h"

/* Its erase and program only while every output is at rest or held. */
struct flash_port model_flash_port(struct device *device);
struct flash_port journal_flash_port(struct device *device);

#endif
