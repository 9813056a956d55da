/* GPIO ports A to C. */
#include "board.h"

#include <string.h>

#define MODER 0
#define PUPDR 3
#define IDR 4
#define ODR 5
#define BSRR 6
#define AFR 8
#define OUTPUT 1
#define FUNCTION 2
#define PIN_BUSY 0
#define PIN_FRSTDATA 1
#define PIN_INTERLOCK 7
#define TRIGGER_PINS 7u /* PC0 to PC2 */

static MemoryRegion regions[3];
static uint32_t regs[3][0x100];
static const int PORTS[3] = {GPIO_A, GPIO_B, GPIO_C};
static uint32_t pulses;

static unsigned mode(enum gpio_port port, unsigned pin)
{
    return regs[port][MODER] >> 2 * pin & 3u;
}

bool gpio_is_function(enum gpio_port port, unsigned pin, unsigned function)
{
    return mode(port, pin) == FUNCTION && (regs[port][AFR + pin / 8] >> 4 * (pin % 8) & 15u) == function;
}

bool gpio_output(enum gpio_port port, unsigned pin, bool pull)
{
    return mode(port, pin) == OUTPUT ? regs[port][ODR] >> pin & 1u : pull;
}

static uint32_t inputs(int port)
{
    uint32_t levels = regs[port][ODR];
    if (port == GPIO_B)
        levels = (levels & ~3u) | (uint32_t)adc_busy() << PIN_BUSY | (uint32_t)adc_frstdata() << PIN_FRSTDATA;
    if (port == GPIO_C)
        levels = (levels & ~(1u << PIN_INTERLOCK)) | (uint32_t)injected.interlock_open << PIN_INTERLOCK;
    return levels & 0xFFFFu;
}

static uint64_t gpio_read(void *opaque, uint64_t offset, unsigned size)
{
    int port = *(const int *)opaque;
    (void)size;
    if (!rcc_on(RCC_AHB1ENR, (unsigned)port))
        return 0;
    return offset / 4 == IDR ? inputs(port) : regs[port][offset / 4];
}

static void note_pulses(uint32_t before)
{
    for (unsigned pin = 0; TRIGGER_PINS >> pin != 0; pin++)
        if (mode(GPIO_C, pin) == OUTPUT)
            pulses |= ~before & regs[GPIO_C][ODR] & 1u << pin;
}

unsigned gpio_take_pulses(void)
{
    unsigned taken = pulses & TRIGGER_PINS;
    pulses = 0;
    return taken;
}

static void gpio_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    int port = *(const int *)opaque;
    (void)size;
    if (!rcc_on(RCC_AHB1ENR, (unsigned)port))
        return;
    const uint32_t before = regs[GPIO_C][ODR];
    if (offset / 4 == BSRR)
        regs[port][ODR] = (regs[port][ODR] & ~((uint32_t)value >> 16)) | ((uint32_t)value & 0xFFFFu);
    else
        regs[port][offset / 4] = (uint32_t)value;
    note_pulses(before);
    converters_pins_changed();
}

void gpio_reset(void)
{
    memset(regs, 0, sizeof regs);
    converters_pins_changed();
}

void gpio_map(void)
{
    static const MemoryRegionOps ops = {
        .read = gpio_read, .write = gpio_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {4, 4, false, NULL}};
    static const char *const NAMES[3] = {"gpioa", "gpiob", "gpioc"};
    for (int port = 0; port < 3; port++) {
        memory_region_init_io(&regions[port], NULL, &ops, (void *)&PORTS[port], NAMES[port], 0x400);
        memory_region_add_subregion_overlap(get_system_memory(), 0x40020000u + 0x400u * (unsigned)port, &regions[port],
                                            10);
    }
}
