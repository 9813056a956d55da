/* The CRC unit: words, top bit first, polynomial 0x04C11DB7. It takes no time here. */
#include "board.h"

#define DR 0
#define CR 2
#define ENABLED_BIT 12
#define POLYNOMIAL 0x04C11DB7u

static MemoryRegion region;
static uint32_t crc;

static uint64_t crc_read(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque, (void)size;
    return offset / 4 == DR && rcc_on(RCC_AHB1ENR, ENABLED_BIT) ? crc : 0;
}

static void crc_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)opaque, (void)size;
    if (!rcc_on(RCC_AHB1ENR, ENABLED_BIT))
        return;
    if (offset / 4 == CR && (value & 1u))
        crc = UINT32_MAX;
    if (offset / 4 != DR)
        return;
    crc ^= (uint32_t)value;
    for (unsigned bit = 0; bit < 32; bit++)
        crc = crc << 1 ^ (crc >> 31 ? POLYNOMIAL : 0);
}

void crc_reset(void)
{
    crc = UINT32_MAX;
}

void crc_map(void)
{
    static const MemoryRegionOps ops = {
        .read = crc_read, .write = crc_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    board_map(&region, &ops, "crc", 0x40023000, 0x400);
}
