#include "dynamics.h"

#include <math.h>
#include <string.h>

#define PI 3.14159265358979323846

/* Two poles that coincide have no simple residues; they are moved apart by this much, relatively. */
#define POLE_SPACING 1e-6

struct chain { /* the three factors of one transfer function */
    const struct plant_axis_parameters *axis;
    double creep_pole[PLANT_CREEPS];
    double complex mode_pole[PLANT_MODES];
    double sensor_pole; /* 0: no sensor */
};

static double complex creep_factor(const struct chain *chain, double complex s)
{
    double complex sum = 1;
    for (unsigned i = 0; i < chain->axis->creeps; i++)
        sum += chain->axis->creep_k[i] * chain->creep_pole[i] / (chain->creep_pole[i] - s);
    return sum;
}

static double complex mode_factor(const struct chain *chain, double complex s)
{
    double complex sum = 1;
    for (unsigned i = 0; i < chain->axis->modes; i++) {
        double complex p = chain->mode_pole[i];
        double complex product = p * conj(p) / ((s - p) * (s - conj(p)));
        sum += chain->axis->mode_c[i] * (product - 1);
    }
    return sum;
}

static double complex sensor_factor(const struct chain *chain, double complex s)
{
    return chain->sensor_pole == 0 ? 1 : chain->sensor_pole / (chain->sensor_pole - s);
}

/* Each weight is -residue / pole: the share of the static response that this pole brings. */
static double creep_weight(const struct chain *chain, unsigned i)
{
    double p = chain->creep_pole[i];
    return creal(chain->axis->creep_k[i] * mode_factor(chain, p) * sensor_factor(chain, p));
}

static double sensor_weight(const struct chain *chain)
{
    return creal(creep_factor(chain, chain->sensor_pole) * mode_factor(chain, chain->sensor_pole));
}

static double complex mode_weight(const struct chain *chain, unsigned i)
{
    double complex p = chain->mode_pole[i];
    double complex residue = chain->axis->mode_c[i] * p * conj(p) / (p - conj(p));
    return -residue / p * creep_factor(chain, p) * sensor_factor(chain, p);
}

static double direct_weight(const struct chain *chain)
{
    if (chain->sensor_pole != 0)
        return 0;
    double rigid = 1;
    for (unsigned i = 0; i < chain->axis->modes; i++)
        rigid -= chain->axis->mode_c[i];
    return rigid;
}

static void place_real(struct dynamics *d, double pole, double tick_s, double split)
{
    double rest = tick_s * (1 - split);
    d->decay[d->reals] = exp(pole * tick_s);
    d->from_old[d->reals] = -exp(pole * rest) * expm1(pole * (tick_s - rest));
    d->from_new[d->reals] = -expm1(pole * rest);
    d->reals++;
}

static void place_pair(struct dynamics *d, double complex pole, double tick_s, double split)
{
    double complex whole = cexp(pole * tick_s), rest = cexp(pole * tick_s * (1 - split));
    double complex from_old = rest - whole, from_new = 1 - rest;
    unsigned i = d->pairs++;
    d->decay_re[i] = creal(whole);
    d->decay_im[i] = cimag(whole);
    d->old_re[i] = creal(from_old);
    d->old_im[i] = cimag(from_old);
    d->new_re[i] = creal(from_new);
    d->new_im[i] = cimag(from_new);
}

static void weigh(struct dynamics *d, unsigned output, const struct chain *chain, int sensor_slot)
{
    for (unsigned i = 0; i < chain->axis->creeps; i++)
        d->weight[output][i] = creep_weight(chain, i);
    for (unsigned i = 0; i < chain->axis->modes; i++) {
        double complex w = 2 * mode_weight(chain, i); /* the pole and its conjugate */
        d->weight_re[output][i] = creal(w);
        d->weight_im[output][i] = cimag(w);
    }
    if (sensor_slot >= 0)
        d->weight[output][sensor_slot] = sensor_weight(chain);
    d->direct[output] = direct_weight(chain);
}

static double apart(double pole, const double *others, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        if (fabs(pole - others[i]) < POLE_SPACING * fabs(pole))
            return apart(pole * (1 + 2 * POLE_SPACING), others, count);
    return pole;
}

bool dynamics_make(struct dynamics *d, const struct plant_axis_parameters *axis, double tick_s, double split,
                   const double *corners_Hz, unsigned corners)
{
    struct chain chain = {.axis = axis};
    memset(d, 0, sizeof *d);
    d->at_rest = true;
    d->sensors = corners;
    for (unsigned i = 0; i < axis->creeps; i++) {
        if (!(axis->creep_tau_s[i] > 0))
            return false;
        chain.creep_pole[i] = apart(-1 / axis->creep_tau_s[i], chain.creep_pole, i);
        place_real(d, chain.creep_pole[i], tick_s, split);
    }
    for (unsigned i = 0; i < axis->modes; i++) {
        double w = 2 * PI * axis->mode_f_Hz[i], zeta = axis->mode_zeta[i];
        if (!(w > 0) || !(zeta > 0) || !(zeta < 1))
            return false;
        chain.mode_pole[i] = w * (-zeta + I * sqrt(1 - zeta * zeta));
        place_pair(d, chain.mode_pole[i], tick_s, split);
    }
    for (unsigned i = 0; i < corners; i++) {
        int slot = -1;
        chain.sensor_pole = 0;
        if (corners_Hz[i] > 0) {
            chain.sensor_pole = apart(-2 * PI * corners_Hz[i], chain.creep_pole, axis->creeps);
            slot = (int)d->reals;
            place_real(d, chain.sensor_pole, tick_s, split);
        }
        weigh(d, i, &chain, slot);
    }
    chain.sensor_pole = 0;
    weigh(d, DYNAMICS_TRUE, &chain, -1);
    return true;
}
