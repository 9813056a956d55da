/* Flash as the bootloader needs it: it reads everything, and programs the boot record alone. */
#ifndef PHASELEAD_STM32F4_RECORD_FLASH_H
#define PHASELEAD_STM32F4_RECORD_FLASH_H

#include "app/image.h"

struct flash_port record_flash_port(void);
uint32_t record_flash_address(unsigned slot); /* enum image_flash_slot */

#endif
