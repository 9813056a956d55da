/* What the sensor and the room add to a position at the moment it is sampled. */
#ifndef PHASELEAD_SIM_SURROUNDINGS_H
#define PHASELEAD_SIM_SURROUNDINGS_H

#include "noise.h"

#define HUM_LINES 3

struct surroundings_parameters {
    double gain;                               /* relative change of the scale, about rest */
    double low_um, high_um;                    /* where the sensor's curve is 0 */
    double quadratic, cubic, quartic, linear;  /* of high - low */
    double jitter_s, lsb_um;                   /* rms; step of the converter, 0: none */
    double ramp_um_per_s, rise_um, rise_tau_s; /* drift */
    double hum_Hz, hum_sin_um[HUM_LINES], hum_cos_um[HUM_LINES];
    double vibration_um_rms, vibration_Hz, vibration_width_Hz;
    double noise_um_rms;
};

struct surroundings {
    const struct surroundings_parameters *with;
    double before_um, step_s;
    double turn[2][2], push[2][2], swing[2]; /* the vibrating mass: position, velocity / w */
};

void surroundings_make(struct surroundings *s, const struct surroundings_parameters *from, double tick_s,
                       struct noise *noise, const struct ziggurat *table);

/* What the sensor says of a displacement about `rest_um` at time t; draws noise. */
double surroundings_sensed_um(struct surroundings *s, double rest_um, double displacement_um, double t_s,
                              struct noise *noise, const struct ziggurat *table);

#endif
