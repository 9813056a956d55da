/* What an instruction, a taken branch and an access to memory cost in cycles of the processor. A model: the sources and
 * the assumptions, each of them towards too many cycles, are in docs/emulation.md.
 */
#include "board.h"

#include <string.h>

/* ARM 100166, Cortex-M4 technical reference manual, table 3-1. */
#define SINGLE 1
#define LOAD_OR_STORE 2 /* of one register, not overlapped with its neighbour */
#define DIVIDE_AT_WORST 12
#define BARRIER 4
#define SPECIAL_REGISTER 2

/* RM0390 and RM0090, flash: six cycles a read of 128 bits at 168 MHz; 64 such lines in the instruction cache. */
#define FLASH_WAITS 5
#define CACHE_LINES 64
#define LINE_SHIFT 4

/* A bus at a fraction of the processor's clock takes two of its own clocks, and up to one to fall in with it. */
#define APB_CLOCKS 3
#define AHB_WAITS 1

static struct {
    uint32_t line;
    uint64_t used; /* when last; 0: holds nothing */
} cache[CACHE_LINES];
static uint64_t uses;
static uint32_t present_line;

static unsigned registers_in(unsigned mask)
{
    unsigned count = 0;
    for (; mask != 0; mask &= mask - 1)
        count++;
    return count;
}

static unsigned cycles_of_16(unsigned word)
{
    switch (word >> 12) {
    case 0x4:
        return word >> 11 == 0x9 ? LOAD_OR_STORE : SINGLE; /* literal; else registers, bx, blx */
    case 0x5:
    case 0x6:
    case 0x7:
    case 0x8:
    case 0x9:
        return LOAD_OR_STORE;
    case 0xB:
        if ((word & 0xF600u) == 0xB400u) /* push, pop */
            return SINGLE + registers_in(word & 0x1FFu);
        return (word & 0xFFE8u) == 0xB660u ? SPECIAL_REGISTER : SINGLE; /* cps */
    case 0xC:
        return SINGLE + registers_in(word & 0xFFu); /* ldm, stm */
    default:
        return SINGLE;
    }
}

static unsigned cycles_of_32(unsigned first, unsigned second)
{
    if ((first & 0xFE40u) == 0xE800u) /* ldm, stm, push, pop */
        return SINGLE + registers_in(second);
    if ((first & 0xFE40u) == 0xE840u) /* ldrd, strd; exclusive ones and table branches cost one less */
        return SINGLE + 2;
    if ((first & 0xFE00u) == 0xF800u)
        return LOAD_OR_STORE;
    if ((first & 0xFFD0u) == 0xFB90u) /* sdiv, udiv; long products take one cycle */
        return DIVIDE_AT_WORST;
    if ((first & 0xFFF0u) == 0xF3B0u && (second & 0x8000u) != 0)
        return BARRIER;
    if ((first & 0xFFD0u) == 0xF380u || (first & 0xFFE0u) == 0xF3E0u)
        return (second & 0x8000u) != 0 ? SPECIAL_REGISTER : SINGLE; /* msr, mrs */
    return SINGLE;
}

unsigned cycles_of(const void *code, size_t size)
{
    uint16_t words[2] = {0, 0};
    memcpy(words, code, size == 2 ? 2 : 4);
    return size == 2 ? cycles_of_16(words[0]) : cycles_of_32(words[0], words[1]);
}

static bool in_flash(uint32_t address)
{
    return address >> 24 == 0x08;
}

void cycles_cache_cold(void)
{
    memset(cache, 0, sizeof cache);
    present_line = 0;
}

void cycles_fetched(uint32_t address)
{
    present_line = address >> LINE_SHIFT;
}

unsigned cycles_of_jump(uint32_t address)
{
    const uint32_t line = address >> LINE_SHIFT;
    unsigned oldest = 0;
    if (!in_flash(address) || line == present_line)
        return 0;
    uses++;
    for (unsigned i = 0; i < CACHE_LINES; i++) {
        if (cache[i].used != 0 && cache[i].line == line) {
            cache[i].used = uses;
            return 0;
        }
        if (cache[i].used < cache[oldest].used)
            oldest = i;
    }
    cache[oldest].line = line;
    cache[oldest].used = uses;
    return FLASH_WAITS;
}

unsigned cycles_of_access(uint32_t address, bool store)
{
    if (in_flash(address))
        return store ? 0 : FLASH_WAITS;
    if (address >> 28 == 0xE)
        return AHB_WAITS;
    if (address >> 28 != 0x4)
        return 0;
    if (address >= 0x40020000u)
        return AHB_WAITS;
    uint64_t apb_Hz = rcc_apb_Hz(address >= 0x40010000u ? 2 : 1);
    return (unsigned)(APB_CLOCKS * rcc_sysclk_Hz() / apb_Hz);
}
