/* An AD7606B behind SPI1 and an AD5764R behind SPI2, at the level of their serial words and pins.
 *
 * Words are exchanged at once: the time they take on the bus is only in the count of cycles.
 */
#include "board.h"

#include <string.h>

#define SPI_CR1 0
#define SPI_SR 2
#define SPI_DR 3
#define CR1_CPHA 0x001u
#define CR1_CPOL 0x002u
#define CR1_MSTR 0x004u
#define CR1_SPE 0x040u
#define CR1_SSM_SSI 0x300u
#define CR1_DFF16 0x800u
#define CR1_MODE (CR1_CPHA | CR1_CPOL | CR1_MSTR | CR1_SPE | CR1_SSM_SSI | CR1_DFF16)
#define SR_RXNE 1u
#define SR_TXE 2u
#define CONVERSION_NS 850
#define DAC_CHANNELS 4
#define DAC_MAX_HZ 30000000u
#define ADC_MAX_HZ 60000000u

struct spi {
    uint32_t regs[0x100];
    bool second;
};

static MemoryRegion regions[2];
static struct spi buses[2] = {{.second = false}, {.second = true}};

static struct {
    uint16_t words[AXES];
    unsigned next; /* channel that the next word brings */
    bool selected;
} adc;

static struct {
    uint16_t data[DAC_CHANNELS], latched[DAC_CHANNELS]; /* two's complement */
    uint16_t gain[DAC_CHANNELS], fine[DAC_CHANNELS], offset[DAC_CHANNELS];
    uint32_t shift, answer;
    unsigned bits;
    bool selected, cleared;
} dac;

bool converters_busy(void)
{
    return injected.adc_silent || now_ns() - timer_period_began_ns() < CONVERSION_NS;
}

bool converters_frstdata(void)
{
    return !injected.adc_silent && adc.selected && adc.next == 0;
}

bool converters_interlock_open(void)
{
    return injected.interlock_open;
}

static uint16_t *dac_register(uint32_t frame, unsigned channel)
{
    switch (frame >> 19 & 7u) {
    case 2:
        return &dac.data[channel];
    case 3:
        return &dac.gain[channel];
    case 4:
        return &dac.fine[channel];
    case 5:
        return &dac.offset[channel];
    default:
        return NULL;
    }
}

static void dac_obey(uint32_t frame)
{
    unsigned channel = frame >> 16 & 7u;
    dac.answer = 0;
    if (frame >> 23 & 1u) {
        uint16_t *from = channel < DAC_CHANNELS ? dac_register(frame, channel) : NULL;
        dac.answer = from ? *from : 0;
        return;
    }
    for (unsigned i = 0; i < DAC_CHANNELS; i++) {
        uint16_t *to = dac_register(frame, i);
        if (to && (channel == 4 || channel == i))
            *to = (uint16_t)frame;
    }
}

/* Chip selects and the clear pin, which the board pulls low. A frame of other than 24 bits is none. */
void converters_pins_changed(void)
{
    bool adc_selected = !gpio_output(GPIO_A, 4, true), dac_selected = !gpio_output(GPIO_B, 12, true);
    bool cleared = !gpio_output(GPIO_C, 6, false);
    if (adc_selected && !adc.selected)
        adc.next = 0;
    adc.selected = adc_selected;
    if (dac_selected && !dac.selected) {
        dac.bits = 0;
        dac.shift = dac.answer;
    } else if (!dac_selected && dac.selected && dac.bits == 24 && !injected.dac_silent) {
        dac_obey(dac.shift);
    }
    dac.selected = dac_selected;
    if (cleared && !dac.cleared) {
        memset(dac.data, 0, sizeof dac.data);
        memset(dac.latched, 0, sizeof dac.latched);
    }
    dac.cleared = cleared;
}

static uint32_t adc_exchange(const struct spi *spi)
{
    bool mode = (spi->regs[SPI_CR1] & CR1_MODE) == (CR1_DFF16 | CR1_SSM_SSI | CR1_SPE | CR1_MSTR | CR1_CPOL);
    bool wired = gpio_is_function(GPIO_A, 5, 5) && gpio_is_function(GPIO_A, 6, 5);
    if (!adc.selected || !mode || !wired || injected.adc_silent || converters_busy())
        return 0;
    unsigned channel = adc.next++;
    return channel < AXES ? adc.words[channel] : 0;
}

static uint32_t dac_exchange(const struct spi *spi, uint32_t byte)
{
    bool mode = (spi->regs[SPI_CR1] & CR1_MODE) == (CR1_SSM_SSI | CR1_SPE | CR1_MSTR | CR1_CPHA);
    bool wired = gpio_is_function(GPIO_B, 13, 5) && gpio_is_function(GPIO_B, 14, 5) && gpio_is_function(GPIO_B, 15, 5);
    if (!dac.selected || !mode || !wired || injected.dac_silent)
        return 0xFF; /* SDO is pulled up */
    uint32_t out = dac.shift >> 16 & 0xFFu;
    dac.shift = (dac.shift << 8 | (byte & 0xFFu)) & 0xFFFFFFu;
    dac.bits += 8;
    return out;
}

static bool clocked(const struct spi *spi)
{
    return spi->second ? rcc_on(RCC_APB1ENR, 14) : rcc_on(RCC_APB2ENR, 12);
}

static uint64_t clock_Hz(const struct spi *spi)
{
    return rcc_apb_Hz(spi->second ? 1 : 2) >> ((spi->regs[SPI_CR1] >> 3 & 7u) + 1);
}

static void check_speed(const struct spi *spi)
{
    uint64_t Hz = clock_Hz(spi);
    if (Hz > (spi->second ? DAC_MAX_HZ : ADC_MAX_HZ))
        board_broken("SPI%d runs at %llu Hz, beyond its converter", spi->second ? 2 : 1, (unsigned long long)Hz);
}

static uint64_t spi_read(void *opaque, uint64_t offset, unsigned size)
{
    struct spi *spi = opaque;
    (void)size;
    if (!clocked(spi))
        return 0;
    if (offset / 4 == SPI_DR)
        spi->regs[SPI_SR] &= ~SR_RXNE;
    return offset / 4 == SPI_SR ? spi->regs[SPI_SR] | SR_TXE : spi->regs[offset / 4];
}

static void spi_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    struct spi *spi = opaque;
    (void)size;
    if (!clocked(spi))
        return;
    spi->regs[offset / 4] = (uint32_t)value;
    if (offset / 4 != SPI_DR || !(spi->regs[SPI_CR1] & CR1_SPE))
        return;
    check_speed(spi);
    unsigned bits = spi->regs[SPI_CR1] & CR1_DFF16 ? 16 : 8;
    count_wait((unsigned)(bits * rcc_sysclk_Hz() / clock_Hz(spi)));
    spi->regs[SPI_DR] = spi->second ? dac_exchange(spi, (uint32_t)value) : adc_exchange(spi);
    spi->regs[SPI_SR] |= SR_RXNE;
}

void converters_convert(const uint16_t codes[AXES])
{
    for (unsigned axis = 0; axis < AXES; axis++)
        adc.words[axis] = (injected.rail_mask >> axis & 1u ? 0xFFFFu : codes[axis]) ^ 0x8000u;
}

/* LDAC has fallen in every tick that TIM2 drove; without it the outputs stay. Codes as the model file counts them. */
void converters_output(uint16_t codes[AXES])
{
    if (timer_runs() && !dac.cleared && !injected.dac_silent)
        memcpy(dac.latched, dac.data, sizeof dac.latched);
    for (unsigned axis = 0; axis < AXES; axis++) {
        if (dac.latched[axis] != 0 && dac.gain[axis] != 1)
            board_broken("the DAC drives axis %u without its range set", axis);
        codes[axis] = dac.latched[axis] ^ 0x8000u;
    }
}

void converters_power_on(void)
{
    memset(&dac, 0, sizeof dac);
    memset(&adc, 0, sizeof adc);
}

void converters_reset(void)
{
    for (int i = 0; i < 2; i++)
        memset(buses[i].regs, 0, sizeof buses[i].regs);
}

void converters_map(void)
{
    static const MemoryRegionOps ops = {
        .read = spi_read, .write = spi_write, .endianness = LITTLE_ENDIAN_DEVICE, .valid = {2, 4, false, NULL}};
    memory_region_init_io(&regions[0], NULL, &ops, &buses[0], "spi1", 0x400);
    memory_region_init_io(&regions[1], NULL, &ops, &buses[1], "spi2", 0x400);
    memory_region_add_subregion_overlap(get_system_memory(), 0x40013000, &regions[0], 10);
    memory_region_add_subregion_overlap(get_system_memory(), 0x40003800, &regions[1], 10);
}
