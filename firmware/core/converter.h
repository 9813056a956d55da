/* Converter codes to physical units and back; 16-bit unipolar codes, zero and scale from calibration.
 *
 * Both give exactly the nearest code or q16 (ties up) for any calibration with the zero of the ADC within +-2^22 codes,
 * then saturate. */
#ifndef PHASELEAD_CORE_CONVERTER_H
#define PHASELEAD_CORE_CONVERTER_H

#include <stdbool.h>
#include <stdint.h>

struct converter_config {
    int32_t dac_zero_code;
    int32_t dac_codes_per_V_q16;
    int32_t adc_zero_q8; /* code of 0 um: rarely a whole one */
    int32_t adc_um_per_code_q32;
};

uint16_t converter_dac_code(const struct converter_config *config, int32_t u_q24, bool *saturated);
int32_t converter_position_q16(const struct converter_config *config, uint16_t adc_code, bool *saturated);

#endif
