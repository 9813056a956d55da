#include "app/model_slot.h"

#define AXES_OFFSET (WIRE_MODEL_SIZE - MODEL_AXES * WIRE_AXIS_MODEL_SIZE)

const struct wire_axis_model *model_axis(const struct model_slot *slot, unsigned axis, struct wire_axis_model *room)
{
    wire_unpack_axis_model(room, slot->blob + AXES_OFFSET + axis * WIRE_AXIS_MODEL_SIZE, WIRE_AXIS_MODEL_SIZE);
    return room;
}

int32_t model_adc_zero_q8(const struct wire_axis_model *model)
{
    return (int32_t)((uint32_t)model->adc_zero_code * 256u + (model->flags >> MODEL_ADC_ZERO_BIT));
}

struct axis_config model_idle_config(const struct wire_axis_model *model)
{
    /* A quarter of 65536 codes of um x 2^-32, as um x 2^-16, is a quarter of the scale as it stands. */
    const bool given = model->error_limit_q16 != 0;
    return (struct axis_config){
        .error_limit_q16 = given ? model->error_limit_q16 : model->adc_um_per_code_q32 / 4,
        .error_ticks = given ? model->error_ticks : MODEL_DEFAULT_ERROR_TICKS,

        .u_park_q24 = model->u_park_q24,
        .ramp_q24 = model->ramp_q24,
        .pid.d_alpha_q31 = PID_DERIVATIVE_UNFILTERED,
        .output = {.u_min_q24 = model->u_min_q24, .u_max_q24 = model->u_max_q24, .slew_q24 = model->slew_q24},
        .converter = {.dac_zero_code = model->dac_zero_code,
                      .dac_codes_per_V_q16 = model->dac_codes_per_V_q16,
                      .adc_zero_q8 = model_adc_zero_q8(model),
                      .adc_um_per_code_q32 = model->adc_um_per_code_q32},
        .code_max = UINT16_MAX,
        .oscillation_limit_q16 = model->oscillation_limit_q16 != 0
                                     ? model->oscillation_limit_q16
                                     : model->adc_um_per_code_q32 / MODEL_DEFAULT_OSCILLATION};
}
