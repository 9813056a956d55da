/* The two SPI buses of the converters, and the pins that select, reset and clear them. */
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
#define SR_BSY 0x80u
#define DAC_MAX_HZ 30000000u
#define ADC_MAX_HZ 60000000u

struct spi {
    uint32_t regs[0x100];
    bool second;
    bool under_way; /* a word, until both of these; the second where cycles are counted */
    int64_t done_ns;
    uint64_t done_cycle;
    uint32_t incoming;
};

static MemoryRegion regions[2];
static struct spi buses[2] = {{.second = false}, {.second = true}};

/* Chip selects, the ADC's reset, and the DAC's clear pin, which the board pulls low. */
void converters_pins_changed(void)
{
    adc_pins(!gpio_output(GPIO_A, 4, true), gpio_output(GPIO_C, 5, false));
    dac_pins(!gpio_output(GPIO_B, 12, true), !gpio_output(GPIO_C, 6, false));
}

static uint32_t exchange(const struct spi *spi, uint32_t word, uint64_t clock_Hz)
{
    uint32_t mode = spi->regs[SPI_CR1] & CR1_MODE;
    if (!spi->second) {
        bool wired = gpio_is_function(GPIO_B, 3, 5) && gpio_is_function(GPIO_A, 6, 5);
        return wired && mode == (CR1_DFF16 | CR1_SSM_SSI | CR1_SPE | CR1_MSTR | CR1_CPOL) ? adc_exchange(spi->done_ns)
                                                                                          : 0;
    }
    bool wired = gpio_is_function(GPIO_B, 13, 5) && gpio_is_function(GPIO_B, 14, 5) && gpio_is_function(GPIO_B, 15, 5);
    return wired && mode == (CR1_SSM_SSI | CR1_SPE | CR1_MSTR | CR1_CPHA) ? dac_exchange(word, clock_Hz) : 0xFF;
}

static bool clocked(const struct spi *spi)
{
    return spi->second ? rcc_on(RCC_APB1ENR, 14) : rcc_on(RCC_APB2ENR, 12);
}

static uint64_t clock_of(const struct spi *spi)
{
    uint64_t Hz = rcc_apb_Hz(spi->second ? 1 : 2) >> ((spi->regs[SPI_CR1] >> 3 & 7u) + 1);
    if (Hz > (spi->second ? DAC_MAX_HZ : ADC_MAX_HZ))
        board_broken("SPI%d runs at %llu Hz, beyond its converter", spi->second ? 2 : 1, (unsigned long long)Hz);
    return Hz;
}

static bool busy(const struct spi *spi)
{
    return spi->under_way && (now_ns() < spi->done_ns || !count_is_over(spi->done_cycle));
}

static void receive(struct spi *spi)
{
    if (!spi->under_way || busy(spi))
        return;
    spi->under_way = false;
    spi->regs[SPI_DR] = spi->incoming;
    spi->regs[SPI_SR] |= SR_RXNE;
}

static uint64_t spi_read(void *opaque, uint64_t offset, unsigned size)
{
    struct spi *spi = opaque;
    (void)size;
    if (!clocked(spi))
        return 0;
    receive(spi);
    if (offset / 4 == SPI_DR) {
        spi->regs[SPI_SR] &= ~SR_RXNE;
        if (!spi->second)
            adc_word_taken();
    }
    return offset / 4 == SPI_SR ? spi->regs[SPI_SR] | SR_TXE | (busy(spi) ? SR_BSY : 0) : spi->regs[offset / 4];
}

static void start_word(struct spi *spi, uint32_t word)
{
    uint64_t Hz = clock_of(spi);
    unsigned bits = spi->regs[SPI_CR1] & CR1_DFF16 ? 16 : 8;
    spi->done_ns = now_ns() + (board.delays ? (int64_t)(bits * 1000000000ull / Hz) : 0);
    spi->done_cycle = count_later((unsigned)(bits * rcc_sysclk_Hz() / Hz));
    spi->incoming = exchange(spi, word, Hz);
    spi->under_way = true;
    receive(spi);
}

static void spi_write(void *opaque, uint64_t offset, uint64_t value, unsigned size)
{
    struct spi *spi = opaque;
    (void)size;
    if (!clocked(spi))
        return;
    if (busy(spi) && (offset / 4 == SPI_DR || offset / 4 == SPI_CR1))
        board_broken("SPI%d was written to while a word was on its way", spi->second ? 2 : 1);
    if (offset / 4 == SPI_DR && spi->regs[SPI_CR1] & CR1_SPE)
        start_word(spi, (uint32_t)value);
    else
        spi->regs[offset / 4] = (uint32_t)value;
}

void converters_power_on(void)
{
    adc_power_on();
    dac_power_on();
}

void converters_reset(void)
{
    for (int i = 0; i < 2; i++) {
        memset(buses[i].regs, 0, sizeof buses[i].regs);
        buses[i].under_way = false;
    }
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
