/* The first 512 KB of flash, which both parts have; the bootloader has sector 0, 16 KB. */
#ifndef PHASELEAD_STM32F4_FLASH_MAP_H
#define PHASELEAD_STM32F4_FLASH_MAP_H

#define BOOT_RECORD_FLASH 0x08004000u /* sector 1, 16 KB */
#define BOOT_RECORD_SECTOR 1u
#define JOURNAL_FLASH 0x08008000u /* sectors 2 and 3, 16 KB each */
#define JOURNAL_SECTOR 2u
#define JOURNAL_FLASH_SIZE 0x4000u
#define MODEL_A_FLASH 0x08010000u /* sector 4, 64 KB */
#define MODEL_A_SECTOR 4u
#define IMAGE_A_FLASH 0x08020000u /* sectors 5 and 6, 128 KB each */
#define IMAGE_A_SECTOR 5u
#define IMAGE_B_FLASH 0x08040000u
#define IMAGE_B_SECTOR 6u
#define IMAGE_FLASH_SIZE 0x20000u
#define MODEL_B_FLASH 0x08060000u /* sector 7, 128 KB */
#define MODEL_B_SECTOR 7u
#define MODEL_FLASH_SIZE 0x10000u /* of which a record uses a few KB */

#endif
