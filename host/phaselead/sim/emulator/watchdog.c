/* The independent watchdog, on an LSI of 32 kHz. */
#include "board.h"

#include <string.h>

#define LSI_HZ 32000
#define KR 0
#define PR 1
#define RLR 2

static MemoryRegion region;
static QEMUTimer bite;
static uint32_t prescaler, reload;
static bool running, unlocked;

static void feed(void)
{
    if (running)
        timer_mod(&bite, now_ns() + (int64_t)(reload + 1) * (4 << prescaler) * (1000000000 / LSI_HZ));
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
        prescaler = value & 7u;
    } else if (offset / 4 == RLR && unlocked) {
        reload = value & 0xFFFu;
    }
}

void watchdog_reset(void)
{
    running = unlocked = false;
    prescaler = 0;
    reload = 0xFFF;
    timer_del(&bite);
}

void watchdog_map(void)
{
    static const MemoryRegionOps ops = {
        .read = read, .write = write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    board_map(&region, &ops, "iwdg", 0x40003000, 0x400);
    timer_init_full(&bite, NULL, CLOCK_VIRTUAL, SCALE_NS, 0, on_bite, NULL);
}
