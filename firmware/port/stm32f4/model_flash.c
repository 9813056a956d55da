#include "port/stm32f4/model_flash.h"

#include <string.h>

#include "app/device_tick.h"
#include "core/fixed.h"
#include "port/stm32f4/board.h"
#include "port/stm32f4/start.h"
#include "port/stm32f4/tick.h"

#define KEY1 0x45670123u
#define KEY2 0xCDEF89ABu
#define LONGEST_TICKS (4 * TICK_RATE_HZ) /* longer than the slowest erase; then the watchdog has its turn */

/* Interrupts are on meanwhile, with the vectors in RAM. An erase sleeps from tick to tick; a byte is there sooner.
 */
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

RAM_CODE static bool program_bytes(volatile uint8_t *to, const uint8_t *bytes, size_t size)
{
    FLASH->CR = FLASH_CR_PG | FLASH_CR_BY_BYTE;
    for (size_t i = 0; i < size; i++) {
        to[i] = bytes[i];
        __asm volatile("dsb");
        if (!wait_until_ready(false))
            return false;
    }
    return true;
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

/* Two sectors, one after the other. */
struct part {
    struct device *device;
    uint32_t sector, address, slot_size;
};

static struct part models = {.sector = MODEL_SECTOR, .address = MODEL_FLASH, .slot_size = MODEL_SLOT_SIZE};
static struct part journal = {.sector = JOURNAL_SECTOR, .address = JOURNAL_FLASH, .slot_size = JOURNAL_SLOT_SIZE};

static uint8_t *slot_address(const struct part *part, unsigned slot)
{
    return (uint8_t *)(part->address + slot * part->slot_size);
}

static bool erase(void *context, unsigned slot)
{
    const struct part *part = context;
    open_flash();
    bool erased = erase_sector(part->sector + slot);
    close_flash(part->device);
    return erased;
}

static bool program(void *context, unsigned slot, uint32_t offset, const uint8_t *bytes, size_t size)
{
    const struct part *part = context;
    if (offset > part->slot_size || size > part->slot_size - offset)
        return false;
    open_flash();
    bool programmed = program_bytes(slot_address(part, slot) + offset, bytes, size);
    close_flash(part->device);
    return programmed;
}

static void read(void *context, unsigned slot, uint32_t offset, uint8_t *bytes, size_t size)
{
    memcpy(bytes, slot_address(context, slot) + offset, size);
}

static struct flash_port port_of(struct part *part, struct device *device)
{
    part->device = device;
    return (struct flash_port){.erase = erase, .program = program, .read = read, .context = part};
}

struct flash_port model_flash_port(struct device *device)
{
    return port_of(&models, device);
}

struct flash_port journal_flash_port(struct device *device)
{
    return port_of(&journal, device);
}
