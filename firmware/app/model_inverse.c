#include "app/model_inverse.h"

#include <string.h>

#include "app/wire_biquad.h"
#include "core/decoupling.h"
#include "core/fixed.h"
#include "core/inverse_make.h"

#define PREVIEW_MOST_Q16 (1024u << 16)
#define OFFSET_MOST_Q16 (1 << 30)         /* 16384 um */
#define ALPHA_MOST_Q48 ((int64_t)1 << 46) /* 1/4 */

_Static_assert(sizeof(((struct wire_axis_model *)0)->play_r_q24) / sizeof(int32_t) == INVERSE_PLAYS, "schema and core");
_Static_assert(sizeof(((struct wire_axis_model *)0)->knot_d_q24) / sizeof(int32_t) == INVERSE_KNOTS, "schema and core");
_Static_assert(sizeof(((struct wire_axis_model *)0)->creep_k_q30) / sizeof(int32_t) == CREEP_TERMS, "schema and core");

static enum model_field filters(const struct wire_axis_model *model, struct compensation *compensation)
{
    if (model->preview_ticks_q16 > PREVIEW_MOST_Q16)
        return FIELD_PREVIEW;
    compensation->preview_ticks_q16 = model->preview_ticks_q16;
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++) {
        compensation->shape[i] = biquad_of_wire(&model->shape[i]);
        if (!biquad_is_usable(&compensation->shape[i]))
            return FIELD_SHAPE;
    }
    compensation->drive = biquad_of_wire(&model->drive[0]);
    return biquad_is_usable(&compensation->drive) ? FIELD_NONE : FIELD_DRIVE;
}

static enum model_field creep(const struct wire_axis_model *model, struct creep_config *config)
{
    for (unsigned i = 0; i < CREEP_TERMS; i++) {
        config->k_q30[i] = model->creep_k_q30[i];
        if (model->creep_alpha_q48[i] < 0 || model->creep_alpha_q48[i] > ALPHA_MOST_Q48)
            return FIELD_CREEP_ALPHA;
        config->alpha_q64[i] = model->creep_alpha_q48[i] * 65536;
    }
    return creep_make(config) ? FIELD_NONE : FIELD_CREEP_K;
}

static enum model_field blamed(enum inverse_verdict verdict)
{
    switch (verdict) {
    case INVERSE_EXISTS:
        return FIELD_NONE;
    case INVERSE_REST_BEYOND_THRESHOLDS:
        return FIELD_REST_FRACTION;
    case INVERSE_PLAYS_OUT_OF_ORDER:
        return FIELD_PLAY_R;
    case INVERSE_WEIGHT_NEGATIVE:
        return FIELD_PLAY_W;
    case INVERSE_KNOTS_OUT_OF_ORDER:
        return FIELD_KNOT_D;
    case INVERSE_FALLS:
        return FIELD_KNOT_S;
    case INVERSE_TOO_STEEP:
    default:
        return FIELD_GAIN;
    }
}

/* Of the way of another axis, what this one sees at most: 0 to 1. */
static int32_t largest_share_q28(const int32_t coupling_q28[DECOUPLE_AXES], unsigned axis)
{
    int64_t largest_q28 = 0;
    for (unsigned from = 0; from < DECOUPLE_AXES; from++) {
        const int64_t size_q28 = coupling_q28[from] < 0 ? -(int64_t)coupling_q28[from] : coupling_q28[from];
        if (from != axis && size_q28 > largest_q28)
            largest_q28 = size_q28;
    }
    return (int32_t)(largest_q28 < DECOUPLE_ONE_Q28 ? largest_q28 : DECOUPLE_ONE_Q28);
}

static enum model_field inverse(const struct wire_axis_model *model, unsigned axis, struct compensation *compensation)
{
    struct inverse_config *config = &compensation->inverse;
    bool beyond = model->offset_q16 > OFFSET_MOST_Q16 || model->offset_q16 < -OFFSET_MOST_Q16;
    config->u_min_q24 = model->u_min_q24;
    config->u_max_q24 = model->u_max_q24;
    config->gain_q20 = model->gain_q20;
    config->offset_q16 = model->offset_q16;
    config->rest_fraction_q30 = model->rest_fraction_q30;
    for (unsigned i = 0; i < INVERSE_PLAYS; i++)
        config->play[i].r_q24 = model->play_r_q24[i];
    memcpy(config->knot_d_q24, model->knot_d_q24, sizeof config->knot_d_q24);
    memcpy(config->knot_s_q20, model->knot_s_q20, sizeof config->knot_s_q20);
    enum model_field field = blamed(inverse_make(config, model->play_w_q20));
    if (field != FIELD_NONE || beyond)
        return beyond ? FIELD_OFFSET : field;
    compensation->per_um_q28 = inverse_per_um_q28(config, largest_share_q28(model->coupling_q28, axis));
    return compensation_make(compensation) ? FIELD_NONE : FIELD_OFFSET;
}

enum model_field model_compensation(const struct wire_axis_model *model, unsigned axis,
                                    struct compensation *compensation)
{
    enum model_field field = filters(model, compensation);
    if (field == FIELD_NONE)
        field = creep(model, &compensation->creep);
    return field == FIELD_NONE ? inverse(model, axis, compensation) : field;
}
