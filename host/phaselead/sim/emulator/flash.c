/* The flash controller with sectors 2, 3, 6 and 7, those that a program changes. While it erases or programs, a read or
 * fetch of any flash ends the run: silicon would only stall, for up to two seconds, and no tick would come.
 */
#include "board.h"

#include <string.h>

#define FLASH_BASE 0x08000000
#define FLASH_SIZE 0x100000
#define JOURNAL 0x08008000
#define MODELS 0x08040000
/* Of 128 KB and of 16 KB, a word at a time: typical by the data sheets. */
#define ERASE_NS 1000000000
#define ERASE_SMALL_NS 250000000
#define PROGRAM_NS 16000
#define ACR 0
#define KEYR 1
#define SR 3
#define CR 4
#define OPTCR 5
#define OPTCR_AT_RESET 0x0FFFAAE1u
#define WAITS_FOR_168_MHZ 5u
#define SR_PGSERR 0x80u
#define SR_PGPERR 0x40u
#define SR_WRPERR 0x10u
#define SR_BSY (1u << 16)
#define CR_PG 1u
#define CR_SER 2u
#define CR_STRT (1u << 16)
#define CR_LOCK (1u << 31)
#define HALF_DONE 0x55u /* bits of the last byte that still changed when the power went */

/* In the image that is kept: the models, behind them the journal. */
static const struct sector {
    uint32_t number, offset, size;
    int64_t erase_ns;
} SECTORS[] = {{6, 0, 0x20000, ERASE_NS},
               {7, 0x20000, 0x20000, ERASE_NS},
               {2, FLASH_MODEL_SIZE, 0x4000, ERASE_SMALL_NS},
               {3, FLASH_MODEL_SIZE + 0x4000, 0x4000, ERASE_SMALL_NS}};

static MemoryRegion controller, models, journal, guards[3];
static QEMUTimer end;
static uint8_t cells[FLASH_KEPT_SIZE];
static bool filled;
static uint32_t regs[8];
static bool half_unlocked, busy, waits_read;
static int64_t cut_after = -1;
static uint64_t changes;

uint8_t *flash_kept(void)
{
    if (!filled)
        memset(cells, 0xFF, sizeof cells);
    filled = true;
    return cells;
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
    if (cut_after > 0 && --cut_after == 0) {
        *cell = (uint8_t)((*cell & ~HALF_DONE) | (to & HALF_DONE));
        inject(INJECT_BROWN_OUT, 0);
        return false;
    }
    *cell = to;
    return true;
}

static void set_busy(bool now)
{
    busy = now;
    for (unsigned i = 0; i < sizeof guards / sizeof guards[0]; i++)
        memory_region_set_enabled(&guards[i], now);
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

static uint64_t touched(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque, (void)size;
    board_broken("flash was read at 0x%08llx while it was busy", (unsigned long long)(FLASH_BASE + offset));
}

static void touched_by_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)value;
    touched(opaque, offset, size);
}

static uint64_t cell_read(uint8_t *cell, unsigned size)
{
    uint64_t value = 0;
    memcpy(&value, cell, size);
    return value;
}

static void cell_write(uint8_t *cell, uint64_t value, unsigned size)
{
    if ((regs[CR] & CR_LOCK) || !(regs[CR] & CR_PG)) {
        regs[SR] |= SR_PGSERR;
        return;
    }
    if (size != 1u << (regs[CR] >> 8 & 3u)) {
        regs[SR] |= SR_PGPERR;
        return;
    }
    for (unsigned i = 0; i < size; i++)
        if (!change(&cell[i], cell[i] & (uint8_t)(value >> 8 * i)))
            break;
    start(PROGRAM_NS);
}

static uint64_t model_read(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque;
    return cell_read(flash_kept() + offset, size);
}

static void model_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)opaque;
    cell_write(flash_kept() + offset, value, size);
}

static uint64_t journal_read(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque;
    return cell_read(flash_kept() + FLASH_MODEL_SIZE + offset, size);
}

static void journal_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)opaque;
    cell_write(flash_kept() + FLASH_MODEL_SIZE + offset, value, size);
}

static void erase(uint32_t number)
{
    const struct sector *sector = NULL;
    for (unsigned i = 0; i < sizeof SECTORS / sizeof SECTORS[0]; i++)
        if (SECTORS[i].number == number)
            sector = &SECTORS[i];
    if (!sector) {
        regs[SR] |= SR_WRPERR;
        return;
    }
    for (size_t i = 0; i < sector->size; i++)
        if (!change(&flash_kept()[sector->offset + i], 0xFF))
            break;
    start(sector->erase_ns);
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
    if (cut_after == 0)
        cut_after = -1; /* the power is back */
}

void flash_map(void)
{
    static const MemoryRegionOps model_ops = {
        .read = model_read, .write = model_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {1, 4, false, NULL}};
    static const MemoryRegionOps journal_ops = {
        .read = journal_read, .write = journal_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {1, 4, false, NULL}};
    static const MemoryRegionOps guard_ops = {
        .read = touched, .write = touched_by_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {1, 4, false, NULL}};
    static const MemoryRegionOps controller_ops = {.read = controller_read,
                                                   .write = controller_write,
                                                   .endianness = LITTLE_ENDIAN_DEVICE,
                                                   .valid = {4, 4, false, NULL}};
    board_map(&controller, &controller_ops, "flash controller", 0x40023C00, 0x400);
    board_map(&models, &model_ops, "model sectors", MODELS, FLASH_MODEL_SIZE);
    board_map(&journal, &journal_ops, "journal sectors", JOURNAL, FLASH_JOURNAL_SIZE);
    /* Around the sectors that are written to while busy. */
    board_map(&guards[0], &guard_ops, "busy flash", FLASH_BASE, JOURNAL - FLASH_BASE);
    board_map(&guards[1], &guard_ops, "busy program", JOURNAL + FLASH_JOURNAL_SIZE,
              MODELS - JOURNAL - FLASH_JOURNAL_SIZE);
    board_map(&guards[2], &guard_ops, "busy flash at 0", 0, FLASH_SIZE);
    set_busy(false);
    timer_init_full(&end, NULL, CLOCK_VIRTUAL, SCALE_NS, 0, on_end, NULL);
}
