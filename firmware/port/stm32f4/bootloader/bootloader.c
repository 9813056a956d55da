/* Starts an image: which one, app/boot_record.h says. Sector 0; the debugger alone can replace it. No heap, no floating
 * point, no interrupts. It runs on the chip's own 16 MHz, touches no pin (the DAC's clear pin is pulled low, so that
 * the outputs are at 0 V) and every wait of it has an end: the watchdog runs from its first lines on.
 */
#include "app/boot_record.h"
#include "port/stm32f4/bootloader/record_flash.h"
#include "port/stm32f4/flash_map.h"
#include "port/stm32f4/registers.h"
#include "port/stm32f4/watchdog.h"

typedef void handler(void);

/* Linker script. */
extern uint32_t stack_top[], data_from[], data_start[], data_end[], zeroed_start[], zeroed_end[];

_Noreturn void bootloader_start(void);

static _Noreturn void reset(void)
{
    __asm volatile("dsb");
    SCB->AIRCR = SCB_AIRCR_RESET;
    for (;;)
        ;
}

static const struct {
    uint32_t *stack;
    handler *exceptions[15];
} vectors __attribute__((section(".vectors"), used)) = {
    .stack = stack_top,
    .exceptions = {bootloader_start, reset, reset, reset, reset, reset, reset, reset, reset, reset, reset, reset, reset,
                   reset, reset},
};

/* RM0090, 4: the chip's unit has the polynomial of CRC-32/ISO-HDLC, but takes words from the top bit on; with each word
 * turned round it gives that CRC, turned round and inverted. `from` and `to` are multiples of 4. A word takes some
 * 9 cycles, so that 64 KB take 9 ms. */
static uint32_t turned_round(uint32_t word)
{
    uint32_t turned;
    __asm("rbit %0, %1" : "=r"(turned) : "r"(word));
    return turned;
}

static uint32_t crc_by_unit(const struct flash_port *flash, unsigned slot, uint32_t crc, uint32_t from, uint32_t to)
{
    const uint32_t *word = (const uint32_t *)(record_flash_address(slot) + from);
    (void)flash;
    (void)crc; /* it begins anew */
    CRC->CR = CRC_CR_RESET;
#pragma GCC unroll 8
    for (uint32_t left = (to - from) / sizeof *word; left > 0; left--)
        CRC->DR = turned_round(*word++);
    return ~turned_round(CRC->DR);
}

static _Noreturn void enter(const struct boot_choice *choice)
{
    const uint32_t *image = (const uint32_t *)(choice->header.address + IMAGE_VECTORS);
    SCB->VTOR = (uint32_t)image;
    __asm volatile("dsb\n isb");
    register uint32_t on_trial __asm("r0") = choice->trial;
    __asm volatile("msr msp, %1\n bx %2" : : "r"(on_trial), "r"(image[0]), "r"(image[1]));
    __builtin_unreachable();
}

_Noreturn void bootloader_start(void)
{
    static const struct boot_places places = {.address = {IMAGE_A_FLASH, IMAGE_B_FLASH}, .slot_size = IMAGE_FLASH_SIZE};
    struct boot_choice choice;
    const uint32_t *from = data_from;
    for (uint32_t *to = data_start; to < data_end; to++)
        *to = *from++;
    for (uint32_t *to = zeroed_start; to < zeroed_end; to++)
        *to = 0;
    watchdog_start(WATCHDOG_SLOW, WATCHDOG_SLOW_RELOAD);
    RCC->AHB1ENR |= RCC_AHB1ENR_CRC;
    (void)RCC->AHB1ENR; /* its clock arrives two cycles later (ES0182, 2.1.13) */
    (void)RCC->AHB1ENR;
    const struct flash_port flash = record_flash_port();
    boot_choose(&flash, &places, crc_by_unit, &choice);
    RCC->AHB1ENR &= ~RCC_AHB1ENR_CRC;
    if (choice.slot != BOOT_NO_SLOT)
        enter(&choice);
    for (;;) /* nothing to start: the watchdog has it look again every few seconds */
        ;
}
