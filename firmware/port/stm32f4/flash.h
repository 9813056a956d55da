/* Flash as the device needs it: two slots for models, two for the journal, two for images, and the boot record. The
 * chip cannot fetch from flash while it erases or programs, for 1 to 2 s an erase, so meanwhile everything that runs is
 * in RAM: the loop that waits, the vectors, the parked tick.
 */
#ifndef PHASELEAD_STM32F4_FLASH_H
#define PHASELEAD_STM32F4_FLASH_H

#include "app/device.h"

/* Erase and program only while every output is at rest or held. */
struct flash_port flash_models(struct device *device);
struct flash_port flash_journal(struct device *device);

/* `on_trial`: as the bootloader said. */
struct update_port flash_images(struct device *device, bool on_trial);

#endif
