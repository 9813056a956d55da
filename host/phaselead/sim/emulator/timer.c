/* TIM2 in its plainest use: up-counting, PWM mode 1 on channels 1 and 2, interrupts at the update and when channel 3
 * compares. */
#include "board.h"

#include <string.h>

#define CR1 0
#define DIER 3
#define SR 4
#define EGR 5
#define CCMR1 6
#define CCER 8
#define CNT 9
#define PSC 10
#define ARR 11
#define CCR2 14
#define CCR3 15
#define UPDATE 1u
#define COMPARE3 8u
#define TIM2_IRQ 28
#define ENABLED_BIT 0
#define LATE_NS (3 * TICK_NS / 2)

static MemoryRegion region;
static QEMUTimer update, compare, idle;
static uint32_t regs[0x100];
static int64_t began_ns; /* the present period */
static uint64_t periods;
static int64_t started_ns;

bool timer_runs(void)
{
    return regs[CR1] & 1u;
}

int64_t timer_period_began_ns(void)
{
    return began_ns;
}

static uint64_t clock_Hz(void)
{
    uint64_t apb = rcc_apb_Hz(1);
    return apb == rcc_sysclk_Hz() ? apb : 2 * apb;
}

static int64_t counts_ns(uint64_t counts)
{
    return (int64_t)((unsigned __int128)counts * (regs[PSC] + 1ull) * 1000000000u / clock_Hz());
}

static int64_t period_begins_ns(uint64_t period)
{
    unsigned __int128 counts = (unsigned __int128)period * (regs[PSC] + 1ull) * (regs[ARR] + 1ull);
    return started_ns + (int64_t)(counts * 1000000000u / clock_Hz());
}

int64_t timer_latch_ns(void)
{
    return began_ns + counts_ns(regs[CCR2]);
}

static void set_irq(void)
{
    board_irq(TIM2_IRQ, regs[SR] & regs[DIER] & (UPDATE | COMPARE3));
}

/* The converters hang on the pins that channels 1 and 2 drive. */
static bool drives_converters(void)
{
    return (regs[CCER] & 0x11u) == 0x11u && (regs[CCMR1] & 0x7070u) == 0x6060u && gpio_is_function(GPIO_A, 0, 1) &&
           gpio_is_function(GPIO_A, 1, 1);
}

static void on_compare(void *opaque)
{
    (void)opaque;
    regs[SR] |= COMPARE3;
    set_irq();
}

/* What comes first first: arming a timer while the processor sleeps lets QEMU skip ahead to it at once. The processor
 * runs only after the callback. */
static void on_update(void *opaque)
{
    (void)opaque;
    began_ns = period_begins_ns(++periods);
    regs[SR] |= UPDATE;
    set_irq();
    if (regs[CCR3] <= regs[ARR])
        timer_mod(&compare, began_ns + counts_ns(regs[CCR3]));
    timer_mod(&update, period_begins_ns(periods + 1));
    timer_mod(&idle, began_ns + LATE_NS);
    if (!drives_converters())
        board_broken("TIM2 runs, but does not drive CONVST and LDAC");
    world_tick(); /* may block until the host says go on */
}

/* Time goes on for the stage and the line while no tick does. */
static void on_idle(void *opaque)
{
    (void)opaque;
    int64_t next_ns = now_ns() + TICK_NS;
    world_tick();
    timer_mod(&idle, next_ns);
}

static uint64_t timer_read(void *opaque, uint64_t offset, unsigned size)
{
    (void)opaque, (void)size;
    if (!rcc_on(RCC_APB1ENR, ENABLED_BIT))
        return 0;
    if (offset / 4 == CNT && timer_runs())
        return (uint64_t)((unsigned __int128)(now_ns() - began_ns) * clock_Hz() / 1000000000u / (regs[PSC] + 1ull)) %
               (regs[ARR] + 1ull);
    return regs[offset / 4];
}

static void timer_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    uint32_t before = regs[offset / 4];
    (void)opaque, (void)size;
    if (!rcc_on(RCC_APB1ENR, ENABLED_BIT))
        return;
    regs[offset / 4] = offset / 4 == SR ? before & (uint32_t)value : (uint32_t)value;
    if (offset / 4 == EGR && value & 1u)
        regs[SR] |= UPDATE;
    if (offset / 4 == CR1 && (value & 1u) && !(before & 1u)) {
        started_ns = began_ns = now_ns();
        periods = 0;
        timer_mod(&update, period_begins_ns(1));
        timer_mod(&idle, period_begins_ns(1) + LATE_NS);
    } else if (offset / 4 == CR1 && !(value & 1u)) {
        timer_del(&update);
        timer_del(&compare);
    }
    set_irq();
}

void timer_reset(void)
{
    memset(regs, 0, sizeof regs);
    regs[ARR] = UINT32_MAX;
    timer_del(&update);
    timer_del(&compare);
    timer_mod(&idle, now_ns() + TICK_NS);
    set_irq();
}

void timer_map(void)
{
    static const MemoryRegionOps ops = {
        .read = timer_read, .write = timer_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    board_map(&region, &ops, "tim2", 0x40000000, 0x400);
    timer_init_full(&update, NULL, CLOCK_VIRTUAL, SCALE_NS, 0, on_update, NULL);
    timer_init_full(&compare, NULL, CLOCK_VIRTUAL, SCALE_NS, 0, on_compare, NULL);
    timer_init_full(&idle, NULL, CLOCK_VIRTUAL, SCALE_NS, 0, on_idle, NULL);
}
