#include "app/hard_limits.h"

#include "core/fixed.h"

bool hard_limits_are_sane(const struct wire_axis_limits *limits)
{
    return limits->dac_min < limits->dac_max && limits->adc_min < limits->adc_max && limits->slew_codes_q16 != 0;
}

/* Lowest voltage whose DAC code is this one or a higher one: code = floor(u scale / 2^40 + 1/2) + zero. */
static int32_t lowest_u_q24(const struct converter_config *converter, int32_t code)
{
    bool saturated = false;
    int64_t scale = converter->dac_codes_per_V_q16;
    int64_t u = (((int64_t)code - converter->dac_zero_code) * 2 - 1) * ((int64_t)1 << 39);
    int64_t quotient = u / scale;
    return sat_i32(quotient + (u % scale > 0), &saturated); /* rounded up */
}

void hard_limits_apply(const struct wire_axis_limits *limits, struct axis_config *config)
{
    struct output_config *output = &config->output;
    const struct converter_config *converter = &config->converter;
    int32_t u_min_q24 = lowest_u_q24(converter, limits->dac_min);
    int32_t beyond_q24 = lowest_u_q24(converter, limits->dac_max + 1);
    int64_t slew_q24 = ((int64_t)limits->slew_codes_q16 << 24) / converter->dac_codes_per_V_q16;
    if (u_min_q24 > output->u_min_q24)
        output->u_min_q24 = u_min_q24;
    if (beyond_q24 <= output->u_max_q24)
        output->u_max_q24 = sub_i32(beyond_q24, 1);
    if (output->u_min_q24 > 0 || output->u_max_q24 < 0)
        output->u_min_q24 = output->u_max_q24 = 0;
    if (slew_q24 < output->slew_q24)
        output->slew_q24 = slew_q24 > 0 ? (int32_t)slew_q24 : 1;
    if (limits->adc_min > config->code_min)
        config->code_min = limits->adc_min;
    if (limits->adc_max < config->code_max)
        config->code_max = limits->adc_max;
}

bool hard_limits_admit(const struct axis_config *config, int32_t u_q24)
{
    const struct output_config *output = &config->output;
    return output->u_min_q24 < output->u_max_q24 && u_q24 >= output->u_min_q24 && u_q24 <= output->u_max_q24 &&
           config->u_park_q24 >= output->u_min_q24 && config->u_park_q24 <= output->u_max_q24;
}
