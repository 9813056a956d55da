/* The wiring that all boards share; what differs is in boards/. docs/board.md has it as a table.
 *
 * PA0 CONVST and PA1 LDAC are driven by TIM2 itself, so that sampling and latching do not wait for the program.
 */
#ifndef PHASELEAD_STM32F4_BOARD_H
#define PHASELEAD_STM32F4_BOARD_H

#include "port/stm32f4/registers.h"

#include BOARD_FILE /* boards/NAME.h; the build gives this and BOARD_NAME, from the section of platformio.ini */

#ifndef PHASELEAD_BAUD
#define PHASELEAD_BAUD 2000000u
#endif

#define SYSCLK_HZ 168000000u
#define APB1_HZ 42000000u
#define APB2_HZ 84000000u
#define TIMER_HZ 84000000u

#define CONVST_HIGH_COUNTS 84u  /* 1 us */
#define SAMPLED_COUNTS 76u      /* 0.9 us: the ADC needs 0.85; the tick begins here, so that it need not wait */
#define LATCH_COUNTS 2520u      /* 30 us from the sample to LDAC, in every build */
#define LATCH_SETUP_COUNTS 143u /* 1.7 us from the last SYNC to LDAC (AD5764R) */

enum port { PORT_A, PORT_B, PORT_C };
enum pin_a { PIN_CONVST = 0, PIN_LDAC = 1, PIN_ADC_CS = 4, PIN_ADC_DOUT = 6 };
enum pin_b {
    PIN_ADC_BUSY = 0,
    PIN_ADC_FRSTDATA = 1,
    PIN_ADC_SCK = 3, /* SPI1 has it on PA5 too, but there the NUCLEO has its LED */
    PIN_DAC_SYNC = 12,
    PIN_DAC_SCK = 13,
    PIN_DAC_SDO = 14,
    PIN_DAC_SDIN = 15
};
enum pin_c {
    PIN_TRIGGER_OUT = 0, /* and the two after it */
    PIN_ADC_RESET = 5,
    PIN_DAC_CLEAR = 6, /* low: 0 V; pulled down on the board */
    PIN_INTERLOCK = 7,
    PIN_TRIGGER_IN = 8
};

#define AF_TIM2 1u
#define AF_SPI 5u
#define AF_USART 7u

/* Code that runs while the flash is busy, and what only it may read. */
#define RAM_CODE __attribute__((section(".ram_code"), noinline, long_call))

#endif
