/* A stage put together link by link, for effects that the exact kernel of plant.c does not have: whatever a stage file
 * lists, in its order, at LINK_SUBSTEPS substeps a tick.
 *
 * Per axis: DAC code -> volts with the converter's curve -> delay -> links on the voltage, the operator, links on the
 * displacement -> coupling of the axes -> links of the sensor -> surroundings. */
#ifndef PHASELEAD_SIM_LINKED_H
#define PHASELEAD_SIM_LINKED_H

#include "link.h"
#include "surroundings.h"

#define LINKED_AXES 3
#define LINKED_LINKS 16
#define LINKED_SENSOR_LINKS 4
#define LINKED_TOP_BITS 8

struct linked_axis_parameters {
    double dac_zero_code, dac_V_per_code;
    double dac_bow_LSB, dac_bit_LSB[LINKED_TOP_BITS]; /* bow over all codes; excess weights, the first bit's first */
    double delay_s; /* from the sample of a tick to the arrival of that tick's voltage */
    double offset_um;
    double from_um_per_um[LINKED_AXES], from_lag_s; /* motion of the others, beside the matrix */
    struct operator_parameters operator;
    struct surroundings_parameters surroundings;
    uint32_t links, sensor_links;
    struct link_parameters link[LINKED_LINKS], sensor_link[LINKED_SENSOR_LINKS];
};

struct linked_parameters {
    double tick_s, coupling[LINKED_AXES][LINKED_AXES];
    uint64_t seed;
    struct linked_axis_parameters axes[LINKED_AXES];
};

struct linked;

/* At rest at 0 V, or NULL. */
struct linked *linked_open(const struct linked_parameters *parameters);
void linked_close(struct linked *linked);

/* What the sensors say now, and where the stage truly is. Draws noise: once per tick. */
void linked_sample(struct linked *linked, double sensed_um[LINKED_AXES], double true_um[LINKED_AXES]);
/* What pushes an axis from now on, as static displacement: it enters behind the hysteresis. */
void linked_push(struct linked *linked, unsigned axis, double um);
void linked_drive(struct linked *linked, const uint16_t dac_codes[LINKED_AXES]);

#endif
