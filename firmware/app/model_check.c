#include "app/model_check.h"

#include <string.h>

#include "app/model_inverse.h"
#include "core/feedforward_tables.h"
#include "core/fixed.h"
#include "core/inverse_make.h"

#define FLAG_TABLE 1u
#define FLAG_INVERSE 2u
#define CODE_MAX 65535
#define COEFFICIENT_LIMIT ((int64_t)1 << 48) /* 65536 um: further than any stage goes */
#define NYQUIST_HZ_Q16 ((int32_t)(TICK_RATE_HZ / 2) << 16)

static bool dac_reaches(const struct wire_axis_model *model, int32_t u_q24)
{
    int64_t code = round_shift_i64((int64_t)u_q24 * model->dac_codes_per_V_q16, 40) + model->dac_zero_code;
    return code >= 0 && code <= CODE_MAX;
}

static bool position_fits(const struct wire_axis_model *model, int32_t code)
{
    int64_t from_zero_q8 = (int64_t)code * 256 - model_adc_zero_q8(model);
    int64_t x_q16 = round_shift_i64(from_zero_q8 * model->adc_um_per_code_q32, 24);
    return x_q16 >= INT32_MIN && x_q16 <= INT32_MAX;
}

static enum model_field check_converters(const struct wire_axis_model *model)
{
    if (model->dac_zero_code < 0 || model->dac_zero_code > CODE_MAX)
        return FIELD_DAC_ZERO;
    if (model->dac_codes_per_V_q16 <= 0)
        return FIELD_DAC_SCALE;
    if (model->adc_zero_code < -CODE_MAX || model->adc_zero_code > 2 * CODE_MAX)
        return FIELD_ADC_ZERO;
    if (model->adc_um_per_code_q32 <= 0 || !position_fits(model, 0) || !position_fits(model, CODE_MAX))
        return FIELD_ADC_SCALE;
    return FIELD_NONE;
}

/* 0 V must be allowed: it is where the converter powers on, and leaving it may not be a jump. */
static enum model_field check_limits(const struct wire_axis_model *model)
{
    if (model->u_min_q24 > 0 || !dac_reaches(model, model->u_min_q24))
        return FIELD_U_MIN;
    if (model->u_max_q24 < 0 || model->u_max_q24 <= model->u_min_q24 || !dac_reaches(model, model->u_max_q24))
        return FIELD_U_MAX;
    if (model->u_park_q24 < model->u_min_q24 || model->u_park_q24 > model->u_max_q24)
        return FIELD_U_PARK;
    if (model->slew_q24 <= 0)
        return FIELD_SLEW;
    if (model->ramp_q24 <= 0 || model->ramp_q24 > model->slew_q24)
        return FIELD_RAMP;
    if (model->error_limit_q16 < 0)
        return FIELD_ERROR_LIMIT;
    if (model->error_limit_q16 != 0 && model->error_ticks == 0)
        return FIELD_ERROR_TICKS;
    if (model->oscillation_limit_q16 < 0)
        return FIELD_OSCILLATION_LIMIT;
    return FIELD_NONE;
}

static enum model_field check_rectangle(const struct wire_axis_model *model)
{
    if (model->swing_min_q24 <= 0)
        return FIELD_SWING_MIN;
    if (model->swing_max_q24 <= model->swing_min_q24)
        return FIELD_SWING_MAX;
    if (model->f_min_q16 <= 0)
        return FIELD_F_MIN;
    if (model->f_max_q16 <= model->f_min_q16 || model->f_max_q16 > NYQUIST_HZ_Q16)
        return FIELD_F_MAX;
    for (unsigned i = 0; i < 6; i++)
        if (model->c_q32[i] > COEFFICIENT_LIMIT || model->c_q32[i] < -COEFFICIENT_LIMIT)
            return FIELD_C;
    return FIELD_NONE;
}

static enum model_field expand_tables(const struct wire_axis_model *model, struct feedforward_tables *tables)
{
    struct feedforward_model law = {.swing_min_q24 = model->swing_min_q24,
                                    .swing_max_q24 = model->swing_max_q24,
                                    .f_min_q16 = model->f_min_q16,
                                    .f_max_q16 = model->f_max_q16};
    for (unsigned i = 0; i < 3; i++)
        law.a_q32[i] = model->a_q32[i];
    for (unsigned i = 0; i < 6; i++)
        law.b_q40[i] = model->b_q40[i];
    switch (feedforward_expand(&law, tables)) {
    case FF_OK:
        return FIELD_NONE;
    case FF_RECTANGLE_EMPTY:
        return FIELD_SWING_MAX;
    case FF_LEAD_OUT_OF_RANGE:
        return FIELD_B;
    case FF_NOT_MONOTONE:
    case FF_GAIN_OUT_OF_RANGE:
    default:
        return FIELD_A;
    }
}

static enum model_field expand_table_view(struct model_slot *slot, unsigned axis, const struct wire_axis_model *model)
{
    enum model_field field = check_rectangle(model);
    if (field == FIELD_NONE)
        field = expand_tables(model, &slot->tables[axis]);
    if (field == FIELD_NONE)
        slot->table_mask |= 1u << axis;
    return field;
}

static enum model_field expand_axis(struct model_slot *slot, unsigned axis, const struct wire_axis_model *model)
{
    if ((model->flags & ~(FLAG_TABLE | FLAG_INVERSE) & ((1u << MODEL_ADC_ZERO_BIT) - 1)) != 0)
        return FIELD_FLAGS;
    enum model_field field = check_converters(model);
    if (field == FIELD_NONE)
        field = check_limits(model);
    if (field == FIELD_NONE && model->flags & FLAG_TABLE)
        field = expand_table_view(slot, axis, model);
    if (field == FIELD_NONE && model->flags & FLAG_INVERSE) {
        struct model_reach *reach = &slot->reach[axis];
        field = model_compensation(model, axis, &slot->compensation[axis]);
        slot->inverse_mask |= field == FIELD_NONE ? 1u << axis : 0;
        if (field == FIELD_NONE)
            inverse_reach_q16(&slot->compensation[axis].inverse, &reach->low_q16, &reach->high_q16);
    }
    slot->idle[axis] = model_idle_config(model);
    return field;
}

/* Of the first axis whose row is to blame; of x when it is the whole that has no inverse. */
static uint16_t expand_coupling(struct model_slot *slot, struct wire_axis_model *room)
{
    int32_t (*coupling_q28)[MODEL_AXES] = slot->coupling_q28;
    for (unsigned axis = 0; axis < MODEL_AXES; axis++) {
        const struct wire_axis_model *model = model_axis(slot, axis, room);
        memcpy(coupling_q28[axis], model->coupling_q28, sizeof coupling_q28[axis]);
        if (!decoupling_takes(coupling_q28[axis], axis))
            return (uint16_t)(100 * axis + FIELD_COUPLING);
    }
    return decoupling_make((const int32_t (*)[MODEL_AXES])coupling_q28, &slot->decoupling) ? 0 : FIELD_COUPLING;
}

static bool has_magic(const uint8_t *blob)
{
    for (unsigned i = 0; i < 4; i++)
        if (blob[i] != (uint8_t)(MODEL_MAGIC >> 8 * i))
            return false;
    return true;
}

uint16_t model_expand(struct model_slot *slot, struct wire_axis_model *room)
{
    slot->table_mask = slot->inverse_mask = 0;
    if (!has_magic(slot->blob))
        return MODEL_FIELD_MAGIC;
    for (unsigned axis = 0; axis < MODEL_AXES; axis++) {
        enum model_field field = expand_axis(slot, axis, model_axis(slot, axis, room));
        if (field != FIELD_NONE)
            return (uint16_t)(100 * axis + field);
    }
    return expand_coupling(slot, room);
}
