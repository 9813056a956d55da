/* What a new chip needs beside the image, for whoever writes firmware.elf by a debugger: the bootloader, and a boot
 * record that says that the image in slot A is confirmed. */
#include "app/boot_record.h"

__asm(".section .bootloader, \"a\"\n"
      ".incbin \"" BOOTLOADER_BINARY "\"\n"
      ".balign 4\n"
      ".text\n");

/* Twice, as it is after a confirmation: magic, kind and slot; image CRC; 0; CRC of the three. */
#define SLOT_A_CONFIRMED 0x4C420300u, 0, 0, SLOT_A_CONFIRMED_CRC
#define SLOT_A_CONFIRMED_CRC 0x40DE87E0u

const uint32_t boot_record_for_debugger[]
    __attribute__((section(".boot_record"), used)) = {SLOT_A_CONFIRMED, SLOT_A_CONFIRMED};
_Static_assert(sizeof boot_record_for_debugger == 2 * BOOT_ENTRY_SIZE, "two entries");
