#include "core/converter.h"

#include "core/fixed.h"

uint16_t converter_dac_code(const struct converter_config *config, int32_t u_q24, bool *saturated)
{
    int64_t code = round_shift_i64((int64_t)u_q24 * config->dac_codes_per_V_q16, 40) + config->dac_zero_code;
    return (uint16_t)sat_between_i64(code, 0, UINT16_MAX, saturated);
}

int32_t converter_position_q16(const struct converter_config *config, uint16_t adc_code, bool *saturated)
{
    /* At most (2^31 + 2^16) 2^31: 64 bits hold it whatever the calibration. */
    int64_t position_q32 = ((int64_t)adc_code - config->adc_zero_code) * config->adc_um_per_code_q32;
    return sat_i32(round_shift_i64(position_q32, 16), saturated);
}
