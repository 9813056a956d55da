/* The converters: an AD7606B (three of its channels) and an AD5764R (three of its four), 16 bits, +-10 V class.
 *
 * TIM2 starts every conversion (CONVST, at the tick's edge) and latches every output (LDAC, LATCH_COUNTS later), so
 * both stand still against the sample whatever the program does. Codes are offset binary, as the model's calibration
 * has them; both parts speak two's complement.
 */
#ifndef PHASELEAD_STM32F4_CONVERTERS_H
#define PHASELEAD_STM32F4_CONVERTERS_H

#include <stdbool.h>
#include <stdint.h>

#define CONVERTER_AXES 3

/* Pins and buses; the DAC stays cleared to 0 V. */
void converters_set_up(void);

/* At full speed: a pulse of 3 us at least, after which the ADC does not convert for 253 us. */
void converters_reset_adc(void);

/* Programs the DAC's range, 0 V on every channel, then lets go of its clear pin. False: it does not answer. */
bool converters_start(void);

enum converters_sampled {
    CONVERTERS_SAMPLED,
    CONVERTERS_SILENT, /* the ADC did not answer */
    CONVERTERS_STALE   /* it answers, but began no conversion with this tick: BUSY did not fall */
};

/* Reads the conversion that the tick's edge began. `codes` stay as before unless it was sampled. */
enum converters_sampled converters_sample(uint16_t codes[CONVERTER_AXES]);

/* Both ends of a longer pulse, for a tick, which cannot wait. */
void converters_hold_adc_in_reset(bool held);

/* Writes the codes of this tick; LDAC makes them the output. */
void converters_drive(const uint16_t codes[CONVERTER_AXES]);

/* Whether the DAC gives back the range that it was given. Takes some 6 us. */
bool converters_dac_answers(void);

/* The code that the DAC holds. Takes as long. */
uint16_t converters_read_back(unsigned axis);

#endif
