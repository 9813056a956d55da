/* RCC and PWR: ready bits that follow their switches, the clock tree as it is set, the cause of the last reset. */
#include "board.h"

#include <string.h>

#define CR 0x00
#define PLLCFGR 0x04
#define CFGR 0x08
#define CIR 0x0C
#define CSR 0x74
#define HSI_HZ 16000000u
#define HSE_HZ 8000000u
#define RMVF (1u << 24)
#define BOR (1u << 25)
#define PIN (1u << 26)
#define POR (1u << 27)
#define SFT (1u << 28)
#define IWDG (1u << 29)
#define CSS_ON (1u << 19)
#define CSS_FLAG (1u << 7)

#define PPRE (63u << 10)
#define SW 3u
#define AHB_CLOCKS 2
#define APB_CLOCKS 1 /* and the prescaler */
#define CLOCK_NS 8   /* an instruction, a cycle at least, takes this long here */
#define PVDE (1u << 4)
#define PVDO (1u << 2)
#define VOSRDY (1u << 14)
#define BOR_OFF 3u

static MemoryRegion rcc, pwr;
static uint32_t pwr_cr;
static bool supply_is_low;
static uint32_t brown_out_option = BOR_OFF;
static int64_t enabled_ns[3][32];
static uint32_t regs[0x100];
static uint32_t flags;
static enum reset_flag next_reset = RESET_POWER_ON;
static bool crystal = true;

static uint32_t cr(void)
{
    uint32_t value = regs[CR / 4] & ~(1u << 1 | 1u << 17 | 1u << 25);
    bool hse = (value >> 16 & 1u) && crystal;
    bool pll = (value >> 24 & 1u) && (hse || !(regs[PLLCFGR / 4] >> 22 & 1u));
    return value | (value & 1u) << 1 | (uint32_t)hse << 17 | (uint32_t)pll << 25;
}

static bool on_pll(void)
{
    return (regs[CFGR / 4] & 3u) == 2u && (cr() >> 25 & 1u);
}

uint64_t rcc_sysclk_Hz(void)
{
    uint32_t pll = regs[PLLCFGR / 4];
    if (!on_pll())
        return (regs[CFGR / 4] & 3u) == 1u ? HSE_HZ : HSI_HZ;
    uint32_t m = pll & 63u, n = pll >> 6 & 511u, p = 2 * ((pll >> 16 & 3u) + 1);
    uint64_t source = pll >> 22 & 1u ? HSE_HZ : HSI_HZ;
    if (m < 2 || source / m < 950000u || source / m > 2100000u || source / m * n > 432000000u ||
        source / m * n < 100000000u)
        board_broken("the PLL is set beyond its limits (PLLCFGR 0x%08x)", pll);
    return source / m * n / p;
}

uint64_t rcc_apb_Hz(unsigned apb)
{
    uint32_t field = regs[CFGR / 4] >> (apb == 1 ? 10 : 13) & 7u;
    uint64_t Hz = rcc_sysclk_Hz() >> (field < 4 ? 0 : field - 3);
    if (Hz > (apb == 1 ? 45000000u : 90000000u))
        board_broken("APB%u runs at %llu Hz, beyond its limit", apb, (unsigned long long)Hz);
    return Hz;
}

static int enable_register(unsigned reg_offset)
{
    return reg_offset == RCC_AHB1ENR ? 0 : reg_offset == RCC_APB1ENR ? 1 : reg_offset == RCC_APB2ENR ? 2 : -1;
}

/* ES0182, 2.1.13: a clock that was just enabled has not arrived yet. */
static int64_t enable_delay_ns(int which)
{
    if (which == 0)
        return (int64_t)AHB_CLOCKS * CLOCK_NS;
    return (int64_t)(APB_CLOCKS + rcc_sysclk_Hz() / rcc_apb_Hz((unsigned)which)) * CLOCK_NS;
}

bool rcc_on(unsigned reg_offset, unsigned bit)
{
    int which = enable_register(reg_offset);
    if (which < 0)
        board_broken("0x%02x is no register that enables clocks", reg_offset);
    if (!(regs[reg_offset / 4] >> bit & 1u))
        return false;
    return !board.delays || now_ns() - enabled_ns[which][bit] >= enable_delay_ns(which);
}

static void note_enabled(unsigned reg_offset, uint32_t value)
{
    int which = enable_register(reg_offset);
    for (unsigned bit = 0; which >= 0 && bit < 32; bit++)
        if ((value & ~regs[reg_offset / 4]) >> bit & 1u)
            enabled_ns[which][bit] = now_ns();
}

/* RM0090, 3.5.1: wait states first, and read back; buses within their limits before the faster clock is taken. */
static void check_switch(uint32_t value)
{
    uint32_t changed = value ^ regs[CFGR / 4];
    if (!board.delays || !(changed & SW) || (value & SW) != 2u)
        return;
    if (changed & PPRE)
        board_broken("the bus prescalers and the clock were switched in one write");
    if (!flash_waits_confirmed())
        board_broken("the clock was raised before the flash's wait states were read back");
}

void rcc_supply(bool low)
{
    if (low && !supply_is_low && pwr_cr & PVDE)
        exti_supply_fell();
    supply_is_low = low;
}

void rcc_brown_out_level(uint32_t option)
{
    brown_out_option = option & 3u;
}

uint32_t rcc_brown_out_option(void)
{
    return brown_out_option;
}

void rcc_reset_by(enum reset_flag flag)
{
    next_reset = flag;
}

/* The pin is pulled low by every reset; RMVF alone clears the flags. */
void rcc_reset(void)
{
    static const uint32_t FLAGS[] = {
        [RESET_POWER_ON] = POR | BOR, [RESET_BROWN_OUT] = BOR, [RESET_WATCHDOG] = IWDG, [RESET_SOFTWARE] = SFT};
    if (next_reset == RESET_BROWN_OUT && brown_out_option == BOR_OFF)
        next_reset = RESET_POWER_ON; /* the dip went on until the power-down reset took it, or nobody saw it */
    flags = (next_reset <= RESET_BROWN_OUT ? 0 : flags) | FLAGS[next_reset] | PIN;
    next_reset = RESET_SOFTWARE;
    memset(regs, 0, sizeof regs);
    pwr_cr = 0;
    regs[CR / 4] = 0x81u;
    regs[PLLCFGR / 4] = 0x24003010u;
}

void rcc_crystal(bool runs)
{
    bool stops = crystal && !runs && (regs[CR / 4] >> 16 & 1u);
    crystal = runs;
    if (stops && regs[CR / 4] & CSS_ON) { /* the clock security system falls back to the internal oscillator */
        regs[CIR / 4] |= CSS_FLAG;
        regs[CFGR / 4] &= ~3u;
        board_nmi();
    }
}

static uint64_t rcc_read(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque, (void)size;
    switch (offset) {
    case CR:
        return cr();
    case CFGR:
        return (regs[CFGR / 4] & ~0xCu) | (on_pll() ? 2u : regs[CFGR / 4] & 1u) << 2;
    case CSR:
        return flags | (regs[CSR / 4] & 1u) << 1 | (regs[CSR / 4] & 1u);
    default:
        return regs[offset / 4 % 0x100];
    }
}

static void rcc_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)opaque, (void)size;
    note_enabled((unsigned)offset, (uint32_t)value);
    if (offset == CFGR)
        check_switch((uint32_t)value);
    if (offset == CIR)
        regs[CIR / 4] &= ~((uint32_t)value >> 16 & 0xFFu);
    else
        regs[offset / 4 % 0x100] = (uint32_t)value;
    if (offset == CSR && value & RMVF)
        flags = 0;
}

static uint64_t pwr_read(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque, (void)size;
    return offset == 4 ? VOSRDY | (pwr_cr & PVDE && supply_is_low ? PVDO : 0) : 0xC000u | pwr_cr;
}

static void pwr_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)opaque, (void)size;
    if (offset == 0)
        pwr_cr = (uint32_t)value;
}

void rcc_map(void)
{
    static const MemoryRegionOps rcc_ops = {
        .read = rcc_read, .write = rcc_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    static const MemoryRegionOps pwr_ops = {
        .read = pwr_read, .write = pwr_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    board_map(&rcc, &rcc_ops, "rcc", 0x40023800, 0x400);
    board_map(&pwr, &pwr_ops, "pwr", 0x40007000, 0x400);
}
