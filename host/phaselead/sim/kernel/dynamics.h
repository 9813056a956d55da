/* The linear part of one axis, (1 + sum k/(tau s + 1)) (1 - sum c + sum c w^2/(s^2 + 2 zeta w s + w^2)) / (T s + 1),
 * as a parallel sum of its poles, each stepped exactly under an input that changes once within a tick. */
#ifndef PHASELEAD_SIM_DYNAMICS_H
#define PHASELEAD_SIM_DYNAMICS_H

#include "plant.h"

#include <complex.h>
#include <stdbool.h>

#define DYNAMICS_REALS (PLANT_CREEPS + PLANT_AXES)
#define DYNAMICS_OUTPUTS (PLANT_AXES + 1) /* behind each distinct sensor, and the true position last */
#define DYNAMICS_TRUE PLANT_AXES

struct dynamics {
    unsigned reals, pairs, sensors;
    bool at_rest; /* every state and the input are still exactly zero */
    double state[DYNAMICS_REALS], decay[DYNAMICS_REALS], from_old[DYNAMICS_REALS], from_new[DYNAMICS_REALS];
    double state_re[PLANT_MODES], state_im[PLANT_MODES];
    double decay_re[PLANT_MODES], decay_im[PLANT_MODES];
    double old_re[PLANT_MODES], old_im[PLANT_MODES], new_re[PLANT_MODES], new_im[PLANT_MODES];
    double weight[DYNAMICS_OUTPUTS][DYNAMICS_REALS];
    double weight_re[DYNAMICS_OUTPUTS][PLANT_MODES], weight_im[DYNAMICS_OUTPUTS][PLANT_MODES];
    double direct[DYNAMICS_OUTPUTS];
};

/* `corners_Hz`: the distinct sensor corners (0: no low-pass). The input changes after `split` of a tick, 0 <= split
 * < 1. False when a parameter is not usable. */
bool dynamics_make(struct dynamics *dynamics, const struct plant_axis_parameters *axis, double tick_s, double split,
                   const double *corners_Hz, unsigned corners);

static inline double dynamics_output(const struct dynamics *d, unsigned output, double input)
{
    double sum = d->direct[output] * input;
    for (unsigned i = 0; i < d->reals; i++)
        sum += d->weight[output][i] * d->state[i];
    for (unsigned i = 0; i < d->pairs; i++)
        sum += d->weight_re[output][i] * d->state_re[i] - d->weight_im[output][i] * d->state_im[i];
    return sum;
}

static inline void dynamics_step(struct dynamics *d, double input_old, double input_new)
{
    for (unsigned i = 0; i < d->reals; i++)
        d->state[i] = d->decay[i] * d->state[i] + d->from_old[i] * input_old + d->from_new[i] * input_new;
    for (unsigned i = 0; i < d->pairs; i++) {
        double re = d->state_re[i], im = d->state_im[i];
        d->state_re[i] =
            d->decay_re[i] * re - d->decay_im[i] * im + d->old_re[i] * input_old + d->new_re[i] * input_new;
        d->state_im[i] =
            d->decay_re[i] * im + d->decay_im[i] * re + d->old_im[i] * input_old + d->new_im[i] * input_new;
    }
}

#endif
