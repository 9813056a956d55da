/* Three lines of the EXTI: 0, on which port B's BUSY falls, 8, on which port C's trigger input rises, and 16, which the
 * supply's voltage detector raises. And the part of SYSCFG that connects them.
 */
#include "board.h"

#include <string.h>

#define IMR 0
#define RTSR 2
#define FTSR 3
#define PR 5
#define EXTICR1 2
#define EXTICR3 4
#define SYSCFG_CLOCK 14
#define LINE_BUSY 0
#define LINE_TRIGGER 8
#define LINE_SUPPLY 16
#define PVD_IRQ 1

static MemoryRegion exti, syscfg;
static uint32_t regs[0x100], connected[0x100];
static bool supply_fell, trigger_rose;

static bool listens(unsigned line, unsigned edge)
{
    return regs[IMR] >> line & 1u && regs[edge] >> line & 1u;
}

static uint32_t pending(void)
{
    bool busy = listens(LINE_BUSY, FTSR) && (connected[EXTICR1] & 15u) == GPIO_B && adc_busy_fell();
    return (uint32_t)busy << LINE_BUSY | (uint32_t)trigger_rose << LINE_TRIGGER | (uint32_t)supply_fell << LINE_SUPPLY;
}

void exti_trigger_rises(void)
{
    trigger_rose = trigger_rose || (listens(LINE_TRIGGER, RTSR) && (connected[EXTICR3] & 15u) == GPIO_C);
}

void exti_supply_fell(void)
{
    if (!listens(LINE_SUPPLY, RTSR))
        return;
    supply_fell = true;
    board_irq(PVD_IRQ, true);
}

static uint64_t exti_read(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque, (void)size;
    return offset / 4 == PR ? pending() : regs[offset / 4];
}

static void exti_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)opaque, (void)size;
    if (offset / 4 != PR) {
        regs[offset / 4] = (uint32_t)value;
        return;
    }
    if (value >> LINE_BUSY & 1u)
        adc_forget_edge();
    if (value >> LINE_TRIGGER & 1u)
        trigger_rose = false;
    if (value >> LINE_SUPPLY & 1u) {
        supply_fell = false;
        board_irq(PVD_IRQ, false);
    }
}

static uint64_t syscfg_read(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque, (void)size;
    return rcc_on(RCC_APB2ENR, SYSCFG_CLOCK) ? connected[offset / 4] : 0;
}

static void syscfg_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    (void)opaque, (void)size;
    if (rcc_on(RCC_APB2ENR, SYSCFG_CLOCK))
        connected[offset / 4] = (uint32_t)value;
}

void exti_reset(void)
{
    memset(regs, 0, sizeof regs);
    memset(connected, 0, sizeof connected);
    supply_fell = trigger_rose = false;
    board_irq(PVD_IRQ, false);
}

void exti_map(void)
{
    static const MemoryRegionOps exti_ops = {
        .read = exti_read, .write = exti_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    static const MemoryRegionOps syscfg_ops = {
        .read = syscfg_read, .write = syscfg_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    board_map(&exti, &exti_ops, "exti", 0x40013C00, 0x400);
    board_map(&syscfg, &syscfg_ops, "syscfg", 0x40013800, 0x400);
}
