#include "port/stm32f4/converters.h"

#include "port/stm32f4/board.h"
#include "port/stm32f4/clock.h"
#include "port/stm32f4/pins.h"

#define CONVERTERS_TWOS_COMPLEMENT 0x8000u

/* A turn of a wait is at least 3 cycles. A conversion takes 0.85 us at most (AD7606B; an AD7606 takes 4.2), a word at
 * 21 MHz 0.8 us, a byte at 5.25 MHz 1.5 us. */
#define CONVERSION_TURNS 200u
#define WORD_TURNS 200u
/* FRSTDATA is valid 30 ns after CS or after the 16th edge at the latest; a read of the bus takes at least 3 clocks of
 * 84 MHz, so that it is looked at some 220 ns into a word of 762 ns. */
#define FRSTDATA_READS 6u
#define RESET_TURNS 300u /* at least 5 us: the AD7606B asks for 3 us */

/* AD5764R, 24-bit frames: read | register << 19 | channel << 16 | data. */
#define DAC_READ (1u << 23)
#define DAC_DATA (2u << 19)
#define DAC_COARSE_GAIN (3u << 19)
#define DAC_CHANNEL(n) ((uint32_t)(n) << 16)
#define DAC_ALL_CHANNELS DAC_CHANNEL(4)
#define DAC_RANGE_10V26 1u /* +-10.2564 V: full scale is at least 10.2 V, as the design asks */
#define DAC_NOP 0u

#define BUSY_LINE BIT(PIN_ADC_BUSY) /* of the EXTI */

/* Data are taken on the falling edge of SCK, which idles low. To write, 42 MHz / 2 = 21 MHz. What comes back is valid
 * 25 ns after the rising edge (AD5764, t15), and half a clock of 21 MHz is 24 ns: to read, 42 MHz / 8 = 5.25 MHz. */
#define DAC_BUS (SPI_CR1_SSM | SPI_CR1_SSI | SPI_CR1_MSTR | SPI_CR1_CPHA)
#define DAC_BUS_FAST (DAC_BUS | SPI_CR1_DIV2)
#define DAC_BUS_SLOW (DAC_BUS | SPI_CR1_DIV8)

static bool word_lost;

static uint32_t received(struct spi *spi)
{
    for (uint32_t turns = WORD_TURNS; turns > 0; turns--)
        if ((spi->SR & SPI_SR_RXNE) != 0)
            return spi->DR;
    word_lost = true;
    return 0;
}

static uint32_t exchange(struct spi *spi, uint32_t word)
{
    spi->DR = word;
    return received(spi);
}

/* A word of the ADC; meanwhile, whether it says that this is the first. */
static uint32_t adc_word(bool *first)
{
    SPI1->DR = 0;
    for (uint32_t reads = FRSTDATA_READS; reads > 0; reads--)
        (void)SPI1->SR;
    *first = pin_is_high(GPIOB, PIN_ADC_FRSTDATA);
    return received(SPI1);
}

/* Gives the data of the frame that comes back; good for something only on the slow bus. */
static uint16_t dac_frame(uint32_t frame)
{
    pin_low(GPIOB, PIN_DAC_SYNC);
    exchange(SPI2, frame >> 16);
    uint32_t answer = exchange(SPI2, frame >> 8 & 0xFFu);
    answer = answer << 8 | exchange(SPI2, frame & 0xFFu);
    pin_high(GPIOB, PIN_DAC_SYNC);
    (void)SPI2->SR; /* SYNC stays high for a while: two reads over a bus of 42 MHz take some 100 ns */
    (void)SPI2->SR;
    return (uint16_t)answer;
}

static void set_dac_bus(uint32_t speed)
{
    for (uint32_t turns = WORD_TURNS; turns > 0 && (SPI2->SR & SPI_SR_BSY) != 0; turns--)
        ;
    SPI2->CR1 = DAC_BUS; /* RM0090, 28.5.1: the speed is not changed while it is on */
    SPI2->CR1 = speed;
    SPI2->CR1 = speed | SPI_CR1_SPE;
}

static void set_up_adc(void)
{
    clock_enable(&RCC->APB2ENR, RCC_APB2ENR_SPI1 | RCC_APB2ENR_SYSCFG);
    pin_set_up(GPIOA, PIN_ADC_CS, PIN_OUTPUT, PULL_NONE, 1);
    pin_set_up(GPIOB, PIN_ADC_SCK, PIN_FUNCTION, PULL_NONE, AF_SPI);
    pin_set_up(GPIOA, PIN_ADC_DOUT, PIN_FUNCTION, PULL_DOWN, AF_SPI);
    pin_set_up(GPIOB, PIN_ADC_BUSY, PIN_INPUT, PULL_UP, 0); /* unplugged, it is busy for ever */
    pin_set_up(GPIOB, PIN_ADC_FRSTDATA, PIN_INPUT, PULL_DOWN, 0);
    pin_set_up(GPIOC, PIN_ADC_RESET, PIN_OUTPUT, PULL_NONE, 1); /* until converters_reset_adc() */
    SYSCFG->EXTICR[0] = SYSCFG_EXTICR_PORT_B;
    EXTI->FTSR |= BUSY_LINE;
    EXTI->IMR |= BUSY_LINE; /* pending is all that is wanted: its interrupt stays off */
    /* Data change on the rising edge of SCK, which idles high; 84 MHz / 4 = 21 MHz. */
    SPI1->CR1 = SPI_CR1_DFF16 | SPI_CR1_SSM | SPI_CR1_SSI | SPI_CR1_DIV4 | SPI_CR1_MSTR | SPI_CR1_CPOL | SPI_CR1_SPE;
}

static void set_up_dac(void)
{
    clock_enable(&RCC->APB1ENR, RCC_APB1ENR_SPI2);
    pin_set_up(GPIOC, PIN_DAC_CLEAR, PIN_OUTPUT, PULL_NONE, 0);
    pin_set_up(GPIOB, PIN_DAC_SYNC, PIN_OUTPUT, PULL_NONE, 1);
    pin_set_up(GPIOB, PIN_DAC_SCK, PIN_FUNCTION, PULL_NONE, AF_SPI);
    pin_set_up(GPIOB, PIN_DAC_SDO, PIN_FUNCTION, PULL_UP, AF_SPI);
    pin_set_up(GPIOB, PIN_DAC_SDIN, PIN_FUNCTION, PULL_NONE, AF_SPI);
    set_dac_bus(DAC_BUS_FAST);
}

void converters_set_up(void)
{
    clock_enable(&RCC->AHB1ENR, RCC_AHB1ENR_GPIO(PORT_A) | RCC_AHB1ENR_GPIO(PORT_B) | RCC_AHB1ENR_GPIO(PORT_C));
    set_up_dac();
    set_up_adc();
    pin_set_up(GPIOA, PIN_CONVST, PIN_FUNCTION, PULL_NONE, AF_TIM2);
    pin_set_up(GPIOA, PIN_LDAC, PIN_FUNCTION, PULL_UP, AF_TIM2);
}

void converters_hold_adc_in_reset(bool held)
{
    if (held)
        pin_high(GPIOC, PIN_ADC_RESET);
    else
        pin_low(GPIOC, PIN_ADC_RESET);
}

void converters_reset_adc(void)
{
    converters_hold_adc_in_reset(true);
    for (volatile uint32_t turns = RESET_TURNS; turns > 0; turns--)
        ;
    converters_hold_adc_in_reset(false);
}

bool converters_start(void)
{
    dac_frame(DAC_COARSE_GAIN | DAC_ALL_CHANNELS | DAC_RANGE_10V26);
    dac_frame(DAC_DATA | DAC_ALL_CHANNELS);
    pin_high(GPIOC, PIN_DAC_CLEAR);
    return converters_dac_answers();
}

/* BUSY has fallen since the last tick and is low: an edge, since a wire that is stuck would look like a conversion. */
static bool conversion_is_done(void)
{
    for (uint32_t turns = CONVERSION_TURNS; turns > 0; turns--)
        if ((EXTI->PR & BUSY_LINE) != 0) {
            EXTI->PR = BUSY_LINE;
            return !pin_is_high(GPIOB, PIN_ADC_BUSY);
        }
    return false;
}

enum converters_sampled converters_sample(uint16_t codes[CONVERTER_AXES])
{
    bool first, second, done = conversion_is_done();
    word_lost = false;
    pin_low(GPIOA, PIN_ADC_CS);
    /* FRSTDATA is high during the first channel and low after it; otherwise no converter is there. */
    uint32_t x = adc_word(&first);
    uint32_t y = adc_word(&second);
    uint32_t z = exchange(SPI1, 0);
    pin_high(GPIOA, PIN_ADC_CS);
    if (!first || second || word_lost)
        return CONVERTERS_SILENT;
    if (!done)
        return CONVERTERS_STALE;
    codes[0] = (uint16_t)(x ^ CONVERTERS_TWOS_COMPLEMENT);
    codes[1] = (uint16_t)(y ^ CONVERTERS_TWOS_COMPLEMENT);
    codes[2] = (uint16_t)(z ^ CONVERTERS_TWOS_COMPLEMENT);
    return CONVERTERS_SAMPLED;
}

void converters_drive(const uint16_t codes[CONVERTER_AXES])
{
    dac_frame(DAC_DATA | DAC_CHANNEL(0) | (codes[0] ^ CONVERTERS_TWOS_COMPLEMENT));
    dac_frame(DAC_DATA | DAC_CHANNEL(1) | (codes[1] ^ CONVERTERS_TWOS_COMPLEMENT));
    dac_frame(DAC_DATA | DAC_CHANNEL(2) | (codes[2] ^ CONVERTERS_TWOS_COMPLEMENT));
}

/* It answers in the next frame, whatever that is. */
static uint16_t dac_register(uint32_t which)
{
    dac_frame(DAC_READ | which);
    set_dac_bus(DAC_BUS_SLOW);
    uint16_t answer = dac_frame(DAC_NOP);
    set_dac_bus(DAC_BUS_FAST);
    return answer;
}

bool converters_dac_answers(void)
{
    return dac_register(DAC_COARSE_GAIN | DAC_CHANNEL(0)) == DAC_RANGE_10V26;
}

uint16_t converters_read_back(unsigned axis)
{
    return (uint16_t)(dac_register(DAC_DATA | DAC_CHANNEL(axis)) ^ CONVERTERS_TWOS_COMPLEMENT);
}
