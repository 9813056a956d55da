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

/* Programs the DAC's range, 0 V on every channel, then lets go of its clear pin. False: it does not answer. */
bool converters_start(void);

/* Reads the conversion that the tick's edge began. False when the converter did not answer: `codes` are then as before.
 */
bool converters_sample(uint16_t codes[CONVERTER_AXES]);

/* Writes the codes of this tick; LDAC makes them the output. */
void converters_drive(const uint16_t codes[CONVERTER_AXES]);

/* Asks the DAC for the range it was given; the answer comes with the next frame it is sent. */
void converters_ask_dac(void);

/* Whether that was the range, with the first frame of converters_drive() or converters_listen(). */
bool converters_dac_answered(void);

/* Takes the DAC's answer without telling it anything. */
void converters_listen(void);

/* The codes that the DAC holds. */
void converters_read_back(uint16_t codes[CONVERTER_AXES]);

#endif
