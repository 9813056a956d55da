/* Fields of record axis_model by their place in protocol/schema.toml, counted from 1: what MODEL_COMMIT names. */
#ifndef PHASELEAD_APP_MODEL_FIELDS_H
#define PHASELEAD_APP_MODEL_FIELDS_H

enum model_field {
    FIELD_NONE,
    FIELD_FLAGS,
    FIELD_U_MIN,
    FIELD_U_MAX,
    FIELD_U_PARK,
    FIELD_SLEW,
    FIELD_RAMP,
    FIELD_DAC_ZERO,
    FIELD_DAC_SCALE,
    FIELD_ADC_ZERO,
    FIELD_ADC_SCALE,
    FIELD_SWING_MIN,
    FIELD_SWING_MAX,
    FIELD_F_MIN,
    FIELD_F_MAX,
    FIELD_A,
    FIELD_B,
    FIELD_C,
    FIELD_PREVIEW,
    FIELD_SHAPE,
    FIELD_DRIVE,
    FIELD_CREEP_K,
    FIELD_CREEP_ALPHA,
    FIELD_GAIN,
    FIELD_OFFSET,
    FIELD_REST_FRACTION,
    FIELD_PLAY_R,
    FIELD_PLAY_W,
    FIELD_KNOT_D,
    FIELD_KNOT_S,
    FIELD_COUPLING,
};

#endif
