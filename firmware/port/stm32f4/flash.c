#include "port/stm32f4/flash.h"

#include <string.h>

#include "app/device_tick.h"
#include "core/fixed.h"
#include "port/stm32f4/board.h"
#include "port/stm32f4/flash_map.h"
#include "port/stm32f4/image_header.h"
#include "port/stm32f4/start.h"
#include "port/stm32f4/tick.h"

#define KEY1 0x45670123u
#define KEY2 0xCDEF89ABu
#define LONGEST_TICKS (4 * TICK_RATE_HZ) /* longer than the slowest erase; then the watchdog has its turn */

/* Interrupts are on meanwhile, with the vectors in RAM. An erase sleeps from tick to tick; a byte is there sooner. */
RAM_CODE static bool wait_until_ready(bool asleep)
{
    uint32_t begin = tick_parked_count;
    while ((FLASH->SR & FLASH_SR_BSY) != 0) {
        if (tick_parked_count - begin > LONGEST_TICKS)
            return false;
        if (asleep)
            __asm volatile("wfi");
    }
    return (FLASH->SR & FLASH_SR_ERRORS) == 0;
}

RAM_CODE static bool erase_sector(uint32_t sector)
{
    FLASH->CR = FLASH_CR_SER | FLASH_CR_SECTOR(sector) | FLASH_CR_BY_WORD;
    FLASH->CR |= FLASH_CR_STRT;
    return wait_until_ready(true);
}

/* A word at a time takes 2.7 V, which supply.c watches over, and a quarter of the time. */
RAM_CODE static bool program_words(volatile uint32_t *to, const uint8_t *bytes, size_t size)
{
    bool done = true;
    FLASH->CR = FLASH_CR_PG | FLASH_CR_BY_WORD;
    for (size_t i = 0; i < size && done; i += sizeof *to) {
        to[i / sizeof *to] =
            bytes[i] | (uint32_t)bytes[i + 1] << 8 | (uint32_t)bytes[i + 2] << 16 | (uint32_t)bytes[i + 3] << 24;
        __asm volatile("dsb");
        done = wait_until_ready(false);
    }
    FLASH->CR = 0;
    return done;
}

RAM_CODE static bool program_bytes(volatile uint8_t *to, const uint8_t *bytes, size_t size)
{
    bool done = true;
    FLASH->CR = FLASH_CR_PG | FLASH_CR_BY_BYTE;
    for (size_t i = 0; i < size && done; i++) {
        to[i] = bytes[i];
        __asm volatile("dsb");
        done = wait_until_ready(false);
    }
    FLASH->CR = 0;
    return done;
}

static void open_flash(void)
{
    tick_lock(NULL);
    tick_parked_count = 0;
    start_vectors_in_ram();
    tick_unlock(NULL);
    FLASH->SR = FLASH_SR_ERRORS | FLASH_SR_EOP;
    FLASH->KEYR = KEY1;
    FLASH->KEYR = KEY2;
}

static void close_flash(struct device *device)
{
    FLASH->CR = FLASH_CR_LOCK;
    FLASH->ACR &= ~FLASH_ACR_DCEN; /* the data cache may hold what was there before */
    FLASH->ACR |= FLASH_ACR_DCRST;
    FLASH->ACR &= ~FLASH_ACR_DCRST;
    FLASH->ACR |= FLASH_ACR_DCEN;
    tick_lock(NULL);
    start_vectors_in_flash();
    device_miss_ticks(device, tick_parked_count);
    tick_unlock(NULL);
}

struct place {
    uint32_t address, size, sector;
};

static const struct place MODELS[] = {{MODEL_A_FLASH, MODEL_FLASH_SIZE, MODEL_A_SECTOR},
                                      {MODEL_B_FLASH, MODEL_FLASH_SIZE, MODEL_B_SECTOR}};
static const struct place JOURNAL[] = {{JOURNAL_FLASH, JOURNAL_FLASH_SIZE, JOURNAL_SECTOR},
                                       {JOURNAL_FLASH + JOURNAL_FLASH_SIZE, JOURNAL_FLASH_SIZE, JOURNAL_SECTOR + 1}};
static const struct place IMAGES[] = {[IMAGE_SLOT_A] = {IMAGE_A_FLASH, IMAGE_FLASH_SIZE, IMAGE_A_SECTOR},
                                      [IMAGE_SLOT_B] = {IMAGE_B_FLASH, IMAGE_FLASH_SIZE, IMAGE_B_SECTOR},
                                      [BOOT_RECORD_SLOT] = {BOOT_RECORD_FLASH, BOOT_RECORD_SIZE, BOOT_RECORD_SECTOR}};

struct places {
    struct device *device;
    const struct place *of;
};

static bool erase(void *context, unsigned slot)
{
    const struct places *places = context;
    open_flash();
    bool erased = erase_sector(places->of[slot].sector);
    close_flash(places->device);
    return erased;
}

static bool program(void *context, unsigned slot, uint32_t offset, const uint8_t *bytes, size_t size)
{
    const struct places *places = context;
    const struct place *place = &places->of[slot];
    const uint32_t to = place->address + offset;
    if (offset > place->size || size > place->size - offset)
        return false;
    open_flash();
    bool programmed = place->sector == IMAGE_A_SECTOR || place->sector == IMAGE_B_SECTOR
                          ? to % 4 == 0 && size % 4 == 0 && program_words((volatile uint32_t *)to, bytes, size)
                          : program_bytes((volatile uint8_t *)to, bytes, size);
    close_flash(places->device);
    return programmed;
}

static void read(void *context, unsigned slot, uint32_t offset, uint8_t *bytes, size_t size)
{
    const struct places *places = context;
    memcpy(bytes, (const uint8_t *)(places->of[slot].address + offset), size);
}

static struct flash_port port_of(struct places *places)
{
    return (struct flash_port){.erase = erase, .program = program, .read = read, .context = places};
}

struct flash_port flash_models(struct device *device)
{
    static struct places places;
    places = (struct places){device, MODELS};
    return port_of(&places);
}

struct flash_port flash_journal(struct device *device)
{
    static struct places places;
    places = (struct places){device, JOURNAL};
    return port_of(&places);
}

struct update_port flash_images(struct device *device, bool on_trial)
{
    static struct places places;
    places = (struct places){device, IMAGES};
    return (struct update_port){.flash = port_of(&places),
                                .places = {.address = {IMAGE_A_FLASH, IMAGE_B_FLASH}, .slot_size = IMAGE_FLASH_SIZE},
                                .slot = image_own_header()->address == IMAGE_B_FLASH ? IMAGE_SLOT_B : IMAGE_SLOT_A,
                                .on_trial = on_trial};
}
