/* A three-axis piezo stage behind its converters, one control tick at a time, in double precision.
 *
 * Per axis: DAC code -> volts -> delay -> hysteresis (gain, plays, one-sided dead zones) -> creep -> resonances ->
 * cross-coupling -> sensor low-pass -> noise -> ADC code. Everything linear after the hysteresis is stepped exactly:
 * its input is constant between the instants at which a DAC code arrives. Stages with other effects are stepped by
 * linked.h instead.
 */
#ifndef PHASELEAD_SIM_PLANT_H
#define PHASELEAD_SIM_PLANT_H

#include "linked.h"

#include <stddef.h>
#include <stdint.h>

#define PLANT_API __attribute__((visibility("default")))

#define PLANT_AXES 3
#define PLANT_PLAYS 64
#define PLANT_DEADZONES 32
#define PLANT_CREEPS 8
#define PLANT_MODES 4
#define PLANT_DELAY_TICKS 63
#define PLANT_FORCES 64

struct plant_axis_parameters {
    double dac_zero_code, dac_V_per_code;
    double adc_x_min_um, adc_codes_per_um; /* code 0 stands for adc_x_min_um */
    double adc_code_max;
    double delay_ticks; /* from the sample of a tick to the arrival of that tick's DAC code; below PLANT_DELAY_TICKS */
    double gain_um_per_V, offset_um;
    double play_r_V[PLANT_PLAYS], play_w_um_per_V[PLANT_PLAYS], play_start_V[PLANT_PLAYS];
    double deadzone_d_V[PLANT_DEADZONES], deadzone_s_um_per_V[PLANT_DEADZONES];
    double creep_k[PLANT_CREEPS], creep_tau_s[PLANT_CREEPS];
    double mode_c[PLANT_MODES], mode_f_Hz[PLANT_MODES], mode_zeta[PLANT_MODES]; /* the rest, 1 - sum c, is rigid */
    double sensor_corner_Hz;                                                    /* 0: none */
    double noise_um_rms;
    uint32_t plays, deadzones, creeps, modes;
};

struct plant_parameters {
    double tick_s;
    double coupling[PLANT_AXES][PLANT_AXES]; /* row: the axis that responds */
    uint64_t seed;
    const struct linked_parameters *linked; /* not NULL: this is the stage, and of the axes only the ADC counts */
    struct plant_axis_parameters axes[PLANT_AXES];
};

struct plant;

/* At rest at 0 V, or NULL: out of memory, or a parameter outside the bounds above. */
PLANT_API struct plant *plant_open(const struct plant_parameters *parameters);
PLANT_API void plant_close(struct plant *plant);
PLANT_API size_t plant_parameters_size(void);
PLANT_API size_t plant_linked_parameters_size(void);

/* The converter codes of this instant. To be called once per tick, before plant_drive(): it draws the noise. */
PLANT_API void plant_sample(struct plant *plant, uint16_t adc_codes[PLANT_AXES]);

/* Latches the DAC codes of this tick and moves on to the next sample. */
PLANT_API void plant_drive(struct plant *plant, const uint16_t dac_codes[PLANT_AXES]);

/* `ticks` ticks against given DAC codes, dac_codes[ticks][3] in, adc_codes[ticks][3] out. */
PLANT_API void plant_run(struct plant *plant, const uint16_t *dac_codes, uint16_t *adc_codes, uint64_t ticks);

/* From the drive of tick `tick` on a further force pushes the stage itself, as `um` of static displacement: behind the
 * hysteresis, before the mechanics. Returns 0, or -1 where there is no such axis, no room for another (PLANT_FORCES),
 * or the tick has passed. */
PLANT_API int plant_push(struct plant *plant, unsigned axis, double um, uint64_t tick);

/* Where the stage truly is at each sample, before the sensor: kept from now on for at most `capacity` ticks (0: stop).
 * Returns 0 on success. */
PLANT_API int plant_trace(struct plant *plant, size_t capacity);

/* Takes what was kept: positions[capacity][3], um. *first is the tick of the first of them. Returns how many there
 * were; those beyond the capacity were dropped, oldest first. */
PLANT_API size_t plant_take_trace(struct plant *plant, double *positions_um, size_t capacity, uint64_t *first);

#endif
