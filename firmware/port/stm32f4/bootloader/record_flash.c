#include "port/stm32f4/bootloader/record_flash.h"

#include "port/stm32f4/flash_map.h"
#include "port/stm32f4/registers.h"

#define KEY1 0x45670123u
#define KEY2 0xCDEF89ABu
#define BYTE_TURNS 2000u /* of at least 4 cycles at 16 MHz: 0.5 ms; a byte takes 100 us at most */
#define RAM_CODE __attribute__((section(".ram_code"), noinline, long_call))

uint32_t record_flash_address(unsigned slot)
{
    return slot == IMAGE_SLOT_A ? IMAGE_A_FLASH : slot == IMAGE_SLOT_B ? IMAGE_B_FLASH : BOOT_RECORD_FLASH;
}

/* From RAM, since a fetch from flash that is busy would only wait. By bytes, which works from 1.7 V on: nobody has
 * looked at the supply yet. */
RAM_CODE static bool program_bytes(volatile uint8_t *to, const uint8_t *bytes, size_t size)
{
    bool done = true;
    FLASH->CR = FLASH_CR_PG | FLASH_CR_BY_BYTE;
    for (size_t i = 0; i < size && done; i++) {
        uint32_t turns = BYTE_TURNS;
        to[i] = bytes[i];
        __asm volatile("dsb");
        while ((FLASH->SR & FLASH_SR_BSY) != 0 && turns > 0)
            turns--;
        done = turns > 0 && (FLASH->SR & FLASH_SR_ERRORS) == 0;
    }
    FLASH->CR = 0;
    return done;
}

static bool program(void *context, unsigned slot, uint32_t offset, const uint8_t *bytes, size_t size)
{
    (void)context;
    if (slot != BOOT_RECORD_SLOT)
        return false;
    FLASH->SR = FLASH_SR_ERRORS | FLASH_SR_EOP;
    FLASH->KEYR = KEY1;
    FLASH->KEYR = KEY2;
    bool done = program_bytes((volatile uint8_t *)(BOOT_RECORD_FLASH + offset), bytes, size);
    FLASH->CR = FLASH_CR_LOCK;
    return done;
}

/* By words: all that is read here is made of them. */
static void read(void *context, unsigned slot, uint32_t offset, uint8_t *bytes, size_t size)
{
    const uint32_t *from = (const uint32_t *)(record_flash_address(slot) + offset);
    uint32_t *to = (uint32_t *)(void *)bytes;
    (void)context;
    for (size_t i = 0; i < size / sizeof *to; i++)
        to[i] = from[i];
}

struct flash_port record_flash_port(void)
{
    return (struct flash_port){.program = program, .read = read};
}
