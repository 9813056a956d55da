/* One stage model in the device: as it came over the wire, and what was made of it. */
#ifndef PHASELEAD_APP_MODEL_SLOT_H
#define PHASELEAD_APP_MODEL_SLOT_H

#include "app/wire.h"
#include "core/axis.h"
#include "core/compensation.h"
#include "core/decouple.h"
#include "core/feedforward.h"

#define MODEL_AXES 3
/* From here on the flags of an axis hold what its code of 0 um is above adc_zero_code, in 256ths. */
#define MODEL_ADC_ZERO_BIT 24
/* A model whose error limit is 0 gets a quarter of the sensor's range, for 0.1 s. */
#define MODEL_DEFAULT_ERROR_TICKS 500u
/* One whose oscillation limit is 0 gets a 256th of the sensor's range: 1.1 um of 280. Far above the noise of any sensor
 * that a loop is closed on, far below what harms a stage. */
#define MODEL_DEFAULT_OSCILLATION 256

/* The positions that an axis' inverse can give. */
struct model_reach {
    int32_t low_q16, high_q16;
};

struct model_slot {
    uint8_t blob[WIRE_MODEL_SIZE]; /* as it came over the wire */
    uint32_t crc;
    uint32_t table_mask;                 /* axes with a table view */
    uint32_t inverse_mask;               /* axes with a time view that can be inverted */
    struct axis_config idle[MODEL_AXES]; /* what an axis begins with: limits, converters and safe value */
    struct feedforward_tables tables[MODEL_AXES];
    struct compensation compensation[MODEL_AXES];
    struct model_reach reach[MODEL_AXES];
    int32_t coupling_q28[MODEL_AXES][MODEL_AXES];
    struct decoupling decoupling;
};

/* One axis of a slot's blob, unpacked into `room`. */
const struct wire_axis_model *model_axis(const struct model_slot *slot, unsigned axis, struct wire_axis_model *room);

/* The code of 0 um, whatever its calibration; wraps beyond 2^23 codes. */
int32_t model_adc_zero_q8(const struct wire_axis_model *model);

/* Idle, without gains or a path. */
struct axis_config model_idle_config(const struct wire_axis_model *model);

#endif
