#include "port/stm32f4/converters.h"

#include "port/stm32f4/board.h"
#include "port/stm32f4/pins.h"

#define CONVERTERS_TWOS_COMPLEMENT 0x8000u

/* A turn of a wait is at least 5 cycles. A conversion takes 0.85 us at most (AD7606B; an AD7606 takes 4.2), a word at
 * 21 MHz 0.8 us. */
#define CONVERSION_TURNS 200u
#define WORD_TURNS 100u

/* AD5764R, 24-bit frames: read | register << 19 | channel << 16 | data. */
#define DAC_READ (1u << 23)
#define DAC_DATA (2u << 19)
#define DAC_COARSE_GAIN (3u << 19)
#define DAC_CHANNEL(n) ((uint32_t)(n) << 16)
#define DAC_ALL_CHANNELS DAC_CHANNEL(4)
#define DAC_RANGE_10V26 1u /* +-10.2564 V: full scale is at least 10.2 V, as the design asks */
#define DAC_NOP 0u

static bool word_lost;
static uint16_t dac_answer; /* data that came back with the first frame of the last drive */

static uint32_t exchange(struct spi *spi, uint32_t word)
{
    spi->DR = word;
    for (uint32_t turns = WORD_TURNS; turns > 0; turns--)
        if ((spi->SR & SPI_SR_RXNE) != 0)
            return spi->DR;
    word_lost = true;
    return 0;
}

/* Gives the data of the frame that comes back. */
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

static void set_up_adc(void)
{
    RCC->APB2ENR |= RCC_APB2ENR_SPI1;
    pin_set_up(GPIOA, PIN_ADC_CS, PIN_OUTPUT, PULL_NONE, 1);
    pin_set_up(GPIOA, PIN_ADC_SCK, PIN_FUNCTION, PULL_NONE, AF_SPI);
    pin_set_up(GPIOA, PIN_ADC_DOUT, PIN_FUNCTION, PULL_DOWN, AF_SPI);
    pin_set_up(GPIOB, PIN_ADC_BUSY, PIN_INPUT, PULL_UP, 0); /* unplugged, it is busy for ever */
    pin_set_up(GPIOB, PIN_ADC_FRSTDATA, PIN_INPUT, PULL_DOWN, 0);
    pin_set_up(GPIOC, PIN_ADC_RESET, PIN_OUTPUT, PULL_NONE, 1);
    /* Data change on the rising edge of SCK, which idles high; 84 MHz / 4 = 21 MHz. */
    SPI1->CR1 = SPI_CR1_DFF16 | SPI_CR1_SSM | SPI_CR1_SSI | SPI_CR1_DIV4 | SPI_CR1_MSTR | SPI_CR1_CPOL | SPI_CR1_SPE;
    pin_low(GPIOC, PIN_ADC_RESET);
}

static void set_up_dac(void)
{
    RCC->APB1ENR |= RCC_APB1ENR_SPI2;
    pin_set_up(GPIOC, PIN_DAC_CLEAR, PIN_OUTPUT, PULL_NONE, 0);
    pin_set_up(GPIOB, PIN_DAC_SYNC, PIN_OUTPUT, PULL_NONE, 1);
    pin_set_up(GPIOB, PIN_DAC_SCK, PIN_FUNCTION, PULL_NONE, AF_SPI);
    pin_set_up(GPIOB, PIN_DAC_SDO, PIN_FUNCTION, PULL_UP, AF_SPI);
    pin_set_up(GPIOB, PIN_DAC_SDIN, PIN_FUNCTION, PULL_NONE, AF_SPI);
    /* Data are taken on the falling edge of SCK, which idles low; 42 MHz / 2 = 21 MHz. */
    SPI2->CR1 = SPI_CR1_SSM | SPI_CR1_SSI | SPI_CR1_DIV2 | SPI_CR1_MSTR | SPI_CR1_CPHA | SPI_CR1_SPE;
}

void converters_set_up(void)
{
    RCC->AHB1ENR |= RCC_AHB1ENR_GPIO(PORT_A) | RCC_AHB1ENR_GPIO(PORT_B) | RCC_AHB1ENR_GPIO(PORT_C);
    set_up_dac();
    set_up_adc();
    pin_set_up(GPIOA, PIN_CONVST, PIN_FUNCTION, PULL_NONE, AF_TIM2);
    pin_set_up(GPIOA, PIN_LDAC, PIN_FUNCTION, PULL_UP, AF_TIM2);
}

bool converters_start(void)
{
    dac_frame(DAC_COARSE_GAIN | DAC_ALL_CHANNELS | DAC_RANGE_10V26);
    dac_frame(DAC_DATA | DAC_ALL_CHANNELS);
    pin_high(GPIOC, PIN_DAC_CLEAR);
    converters_ask_dac();
    dac_answer = dac_frame(DAC_NOP);
    return converters_dac_answered();
}

static bool conversion_is_done(void)
{
    for (uint32_t turns = CONVERSION_TURNS; turns > 0; turns--)
        if (!pin_is_high(GPIOB, PIN_ADC_BUSY))
            return true;
    return false;
}

bool converters_sample(uint16_t codes[CONVERTER_AXES])
{
    bool done = conversion_is_done();
    word_lost = false;
    pin_low(GPIOA, PIN_ADC_CS);
    /* FRSTDATA is high during the first channel and low after it; otherwise no converter is there. */
    bool first = pin_is_high(GPIOB, PIN_ADC_FRSTDATA);
    uint32_t x = exchange(SPI1, 0);
    bool still_first = pin_is_high(GPIOB, PIN_ADC_FRSTDATA);
    uint32_t y = exchange(SPI1, 0);
    uint32_t z = exchange(SPI1, 0);
    pin_high(GPIOA, PIN_ADC_CS);
    if (!done || !first || still_first || word_lost)
        return false;
    codes[0] = (uint16_t)(x ^ CONVERTERS_TWOS_COMPLEMENT);
    codes[1] = (uint16_t)(y ^ CONVERTERS_TWOS_COMPLEMENT);
    codes[2] = (uint16_t)(z ^ CONVERTERS_TWOS_COMPLEMENT);
    return true;
}

void converters_drive(const uint16_t codes[CONVERTER_AXES])
{
    dac_answer = dac_frame(DAC_DATA | DAC_CHANNEL(0) | (codes[0] ^ CONVERTERS_TWOS_COMPLEMENT));
    dac_frame(DAC_DATA | DAC_CHANNEL(1) | (codes[1] ^ CONVERTERS_TWOS_COMPLEMENT));
    dac_frame(DAC_DATA | DAC_CHANNEL(2) | (codes[2] ^ CONVERTERS_TWOS_COMPLEMENT));
}

void converters_ask_dac(void)
{
    dac_frame(DAC_READ | DAC_COARSE_GAIN | DAC_CHANNEL(0));
}

bool converters_dac_answered(void)
{
    return dac_answer == DAC_RANGE_10V26;
}

void converters_listen(void)
{
    dac_answer = dac_frame(DAC_NOP);
}

void converters_read_back(uint16_t codes[CONVERTER_AXES])
{
    dac_frame(DAC_READ | DAC_DATA | DAC_CHANNEL(0));
    for (unsigned axis = 0; axis < CONVERTER_AXES; axis++) { /* each answer comes with the next frame */
        uint32_t next = axis + 1 < CONVERTER_AXES ? DAC_READ | DAC_DATA | DAC_CHANNEL(axis + 1) : DAC_NOP;
        codes[axis] = (uint16_t)(dac_frame(next) ^ CONVERTERS_TWOS_COMPLEMENT);
    }
}
