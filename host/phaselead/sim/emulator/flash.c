/* The flash controller with sectors 1 to 7; nothing writes to sector 0, the bootloader's. What it holds is QEMU's own
 * memory, from which the processor executes; while the controller programs, stores to it come here. While it erases or
 * programs, a read or fetch of any flash ends the run: silicon would only stall, for up to two seconds, and no tick
 * would come.
 */
#include "board.h"

#include <string.h>

#define FLASH_BASE 0x08000000
#define FLASH_AT_0 0x00000000 /* the same cells, as the processor has them after a reset */
#define FIRST_SECTOR 1u
#define LAST_SECTOR 7u
#define PROGRAM_NS 16000
#define ACR 0
#define KEYR 1
#define SR 3
#define CR 4
#define OPTCR 5
#define OPTCR_AT_RESET 0x0FFFAAE1u
#define WAITS_FOR_168_MHZ 5u
#define SR_PGPERR 0x40u
#define SR_WRPERR 0x10u
#define SR_BSY (1u << 16)
#define CR_PG 1u
#define CR_SER 2u
#define CR_STRT (1u << 16)
#define CR_LOCK (1u << 31)
#define HALF_DONE 0x55u /* bits of the last byte that still changed when the power went */

/* By sector, and the end of the last one. */
static const uint32_t SECTORS[] = {0, 0x4000, 0x8000, 0xC000, 0x10000, 0x20000, 0x40000, 0x60000, FLASH_CELLS};

/* A word at a time, of 16, 64 and 128 KB: typical by the data sheets. */
static const int64_t ERASE_NS[] = {0, 250000000, 250000000, 250000000, 550000000, 1000000000, 1000000000, 1000000000};

static MemoryRegion controller, watched, watched_at_0;
static QEMUTimer end;
static uint8_t cells[FLASH_CELLS];
static bool filled;
static uint32_t regs[8];
static bool half_unlocked, busy, waits_read, watching;
static int64_t cut_after = -1;
static uint64_t changes;
static size_t changed_from, changed_to; /* of `cells`, not yet where the processor sees it */

/* What was loaded is known only once the processor runs. */
const uint8_t *flash_cells(void)
{
    if (!filled)
        cpu_physical_memory_rw(FLASH_AT_0, cells, sizeof cells, false);
    filled = true;
    return cells;
}

void flash_poke(uint32_t address, const uint8_t *bytes, size_t size)
{
    address_space_write_rom(address_space_memory, address, 1, bytes, size);
    if (address - FLASH_BASE < FLASH_CELLS && size <= FLASH_CELLS - (address - FLASH_BASE) && filled)
        memcpy(cells + (address - FLASH_BASE), bytes, size);
}

uint64_t flash_changes(void)
{
    return changes;
}

void flash_cut_after(int64_t changes)
{
    cut_after = changes;
}

static bool change(uint8_t *cell, uint8_t to)
{
    if (cut_after == 0)
        return false;
    if (cut_after > 0)
        cut_after--;
    if (cut_after == 0) {
        *cell = (uint8_t)((*cell & ~HALF_DONE) | (to & HALF_DONE));
        inject(INJECT_BROWN_OUT, 0);
        return false;
    }
    *cell = to;
    return true;
}

/* Every access is looked at while flash is busy or bits can be programmed; then the processor sees what was changed. At
 * other times a store is lost, as QEMU's memory is ROM. */
static void watch(void)
{
    const bool now = busy || ((regs[CR] & CR_PG) && !(regs[CR] & CR_LOCK));
    if (now == watching)
        return;
    flash_cells();
    watching = now;
    memory_region_set_enabled(&watched, now);
    memory_region_set_enabled(&watched_at_0, now);
    if (!now && changed_from < changed_to)
        address_space_write_rom(address_space_memory, FLASH_AT_0 + changed_from, 1, cells + changed_from,
                                changed_to - changed_from);
    if (!now)
        changed_from = changed_to = 0;
}

static void set_busy(bool now)
{
    busy = now;
    watch();
}

static void on_end(void *opaque)
{
    (void)opaque;
    set_busy(false);
}

static void start(int64_t ns)
{
    changes++;
    set_busy(true);
    timer_mod(&end, now_ns() + ns);
}

static uint64_t cell_read(void *opaque, uint64_t offset, unsigned size)
{
    uint64_t value = 0;
    (void)opaque;
    if (busy)
        board_broken("flash was read at 0x%08llx while it was busy", (unsigned long long)(FLASH_BASE + offset));
    memcpy(&value, flash_cells() + offset, size);
    return value;
}

static void note_changed(size_t from, size_t to)
{
    const bool none = changed_from == changed_to;
    changed_from = none || from < changed_from ? from : changed_from;
    changed_to = none || to > changed_to ? to : changed_to;
}

static void cell_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)opaque;
    if (busy || offset < SECTORS[FIRST_SECTOR])
        board_broken("flash was written at 0x%08llx %s", (unsigned long long)(FLASH_BASE + offset),
                     busy ? "while it was busy" : "where the bootloader is");
    if (size != 1u << (regs[CR] >> 8 & 3u)) {
        regs[SR] |= SR_PGPERR;
        return;
    }
    for (unsigned i = 0; i < size; i++)
        if (!change(&cells[offset + i], cells[offset + i] & (uint8_t)(value >> 8 * i)))
            break;
    note_changed(offset, offset + size);
    start(PROGRAM_NS);
}

static void erase(uint32_t sector)
{
    if (sector < FIRST_SECTOR || sector > LAST_SECTOR) {
        regs[SR] |= SR_WRPERR;
        return;
    }
    start(ERASE_NS[sector]);
    for (size_t i = SECTORS[sector]; i < SECTORS[sector + 1]; i++)
        if (!change(&cells[i], 0xFF))
            break;
    note_changed(SECTORS[sector], SECTORS[sector + 1]);
}

static uint64_t controller_read(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque, (void)size;
    if (offset / 4 >= 8)
        return 0;
    if (offset / 4 == ACR)
        waits_read = true;
    if (offset / 4 == OPTCR)
        return OPTCR_AT_RESET | rcc_brown_out_option() << 2;
    return regs[offset / 4] | (offset / 4 == SR && busy ? SR_BSY : 0);
}

static void write_key(uint32_t key)
{
    if (key == 0xCDEF89ABu && half_unlocked)
        regs[CR] &= ~CR_LOCK;
    half_unlocked = key == 0x45670123u;
}

static void controller_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)opaque, (void)size;
    if (offset / 4 == KEYR)
        write_key((uint32_t)value);
    else if (offset / 4 == SR)
        regs[SR] &= ~(uint32_t)value;
    else if (offset / 4 == CR) {
        if (!(regs[CR] & CR_LOCK) && !busy)
            regs[CR] = (uint32_t)value & ~CR_STRT;
        watch();
        if (!(regs[CR] & CR_LOCK) && (value & CR_STRT) && (value & CR_SER) && !busy)
            erase((uint32_t)value >> 3 & 15u);
    } else if (offset / 4 == ACR) {
        regs[ACR] = (uint32_t)value;
        waits_read = false;
    }
}

bool flash_waits_confirmed(void)
{
    return waits_read && (regs[ACR] & 7u) >= WAITS_FOR_168_MHZ;
}

void flash_reset(void)
{
    memset(regs, 0, sizeof regs);
    regs[CR] = CR_LOCK;
    half_unlocked = false;
    timer_del(&end);
    set_busy(false);
}

void flash_map(void)
{
    static const MemoryRegionOps cell_ops = {
        .read = cell_read, .write = cell_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {1, 4, false, NULL}};
    static const MemoryRegionOps controller_ops = {.read = controller_read,
                                                   .write = controller_write,
                                                   .endianness = LITTLE_ENDIAN_DEVICE,
                                                   .valid = {4, 4, false, NULL}};
    board_map(&controller, &controller_ops, "flash controller", 0x40023C00, 0x400);
    board_map(&watched, &cell_ops, "flash", FLASH_BASE, FLASH_CELLS);
    board_map(&watched_at_0, &cell_ops, "flash at 0", FLASH_AT_0, FLASH_CELLS);
    memory_region_set_enabled(&watched, false);
    memory_region_set_enabled(&watched_at_0, false);
    timer_init_full(&end, NULL, CLOCK_VIRTUAL, SCALE_NS, 0, on_end, NULL);
}
