#include "core/converter.h"

#include "core/fixed.h"

uint16_t converter_dac_code(const struct converter_config *config, int32_t u_q24, bool *saturated)
{
    /* At most 2^22 codes from the zero. */
    int32_t code = add_i32((int32_t)mul_shift_wide_i32(u_q24, config->dac_codes_per_V_q16, 40), config->dac_zero_code);
    return (uint16_t)sat_between_i64(code, 0, UINT16_MAX, saturated);
}

int32_t converter_position_q16(const struct converter_config *config, uint16_t adc_code, bool *saturated)
{
    int32_t from_zero_q8 = (int32_t)(((uint32_t)adc_code << 8) - (uint32_t)config->adc_zero_q8);
    return mul_shift_i32(from_zero_q8, config->adc_um_per_code_q32, 24, saturated);
}
