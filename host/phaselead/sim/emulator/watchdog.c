/* The independent watchdog, on an LSI of 32 kHz, or with delays at its slowest. */
#include "board.h"

#include <string.h>

#define LSI_HZ 32000
#define LSI_SLOWEST_HZ 17000
#define LSI_START_NS 40000
#define UPDATE_CYCLES 5 /* until a new prescaler or reload counts */
#define KR 0
#define PR 1
#define RLR 2
#define SR 3

static MemoryRegion region;
static QEMUTimer bite;
static uint32_t prescaler, reload;
static bool running, unlocked;
static uint32_t prescaler_before, reload_before;
static int64_t updated_ns[3]; /* by register: when what was written counts */

static int64_t lsi_ns(void)
{
    return 1000000000 / (board.delays ? LSI_SLOWEST_HZ : LSI_HZ);
}

static bool updating(int which)
{
    return board.delays && now_ns() < updated_ns[which];
}

static void feed(void)
{
    uint32_t from = updating(RLR) ? reload_before : reload, by = updating(PR) ? prescaler_before : prescaler;
    if (running)
        timer_mod(&bite, now_ns() + (int64_t)(from + 1) * (4 << by) * lsi_ns());
}

static void update(int which, uint32_t *present, uint32_t *before, uint32_t value)
{
    if (updating(which))
        return; /* RM0090, 21.3.2: only once the flag has fallen */
    *before = *present;
    *present = value;
    updated_ns[which] = now_ns() + LSI_START_NS + UPDATE_CYCLES * lsi_ns();
}

static void on_bite(void *opaque)
{
    (void)opaque;
    rcc_reset_by(RESET_WATCHDOG);
    qemu_system_reset_request(CAUSE_GUEST_RESET);
}

static uint64_t read(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque, (void)size;
    if (offset / 4 == SR)
        return (uint64_t)updating(PR) | (uint64_t)updating(RLR) << 1;
    return offset / 4 == PR ? prescaler : offset / 4 == RLR ? reload : 0;
}

static void write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)opaque, (void)size;
    if (offset / 4 == KR) {
        unlocked = value == 0x5555;
        running = running || value == 0xCCCC;
        if (value == 0xAAAA || value == 0xCCCC)
            feed();
    } else if (offset / 4 == PR && unlocked) {
        update(PR, &prescaler, &prescaler_before, value & 7u);
    } else if (offset / 4 == RLR && unlocked) {
        update(RLR, &reload, &reload_before, value & 0xFFFu);
    }
}

void watchdog_reset(void)
{
    running = unlocked = false;
    prescaler = 0;
    reload = reload_before = 0xFFF;
    prescaler_before = 0;
    memset(updated_ns, 0, sizeof updated_ns);
    timer_del(&bite);
}

void watchdog_map(void)
{
    static const MemoryRegionOps ops = {
        .read = read, .write = write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    board_map(&region, &ops, "iwdg", 0x40003000, 0x400);
    timer_init_full(&bite, NULL, CLOCK_VIRTUAL, SCALE_NS, 0, on_bite, NULL);
}
