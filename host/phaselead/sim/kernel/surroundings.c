#include "surroundings.h"

#include <math.h>
#include <string.h>

#define PI 3.14159265358979323846

/* A mass on a damped spring under white force, in units that make its stationary covariance the unit matrix:
 * z' = A z + noise, A = w [[0, 1], [-1, -2 zeta]]; the exact step has covariance 1 - exp(A h) exp(A h)^T. */
static void vibration_make(struct surroundings *s, double w, double zeta)
{
    double h = s->step_s, damped = sqrt(1 - zeta * zeta), shrink = exp(-zeta * w * h);
    double c = cos(w * damped * h), si = sin(w * damped * h) / damped;
    s->turn[0][0] = shrink * (c + zeta * si);
    s->turn[0][1] = shrink * si;
    s->turn[1][0] = -shrink * si;
    s->turn[1][1] = shrink * (c - zeta * si);
    double q00 = 1 - s->turn[0][0] * s->turn[0][0] - s->turn[0][1] * s->turn[0][1];
    double q10 = -s->turn[0][0] * s->turn[1][0] - s->turn[0][1] * s->turn[1][1];
    double q11 = 1 - s->turn[1][0] * s->turn[1][0] - s->turn[1][1] * s->turn[1][1];
    s->push[0][0] = sqrt(fmax(q00, 0));
    s->push[1][0] = s->push[0][0] > 0 ? q10 / s->push[0][0] : 0;
    s->push[1][1] = sqrt(fmax(q11 - s->push[1][0] * s->push[1][0], 0));
}

void surroundings_make(struct surroundings *s, const struct surroundings_parameters *from, double tick_s,
                       struct noise *noise, const struct ziggurat *table)
{
    memset(s, 0, sizeof *s);
    s->with = from;
    s->step_s = tick_s;
    if (from->vibration_um_rms > 0) {
        double zeta = from->vibration_width_Hz / (2 * from->vibration_Hz);
        vibration_make(s, 2 * PI * from->vibration_Hz, zeta < 0.999 ? zeta : 0.999);
        s->swing[0] = noise_gaussian(noise, table);
        s->swing[1] = noise_gaussian(noise, table);
    }
}

static double vibration_um(struct surroundings *s, struct noise *noise, const struct ziggurat *table)
{
    double a = noise_gaussian(noise, table), b = noise_gaussian(noise, table);
    double x = s->turn[0][0] * s->swing[0] + s->turn[0][1] * s->swing[1] + s->push[0][0] * a;
    double v = s->turn[1][0] * s->swing[0] + s->turn[1][1] * s->swing[1] + s->push[1][0] * a + s->push[1][1] * b;
    s->swing[0] = x;
    s->swing[1] = v;
    return s->with->vibration_um_rms * x;
}

static double room_um(const struct surroundings_parameters *p, double t_s)
{
    double x = p->ramp_um_per_s * t_s;
    if (p->rise_um != 0)
        x -= p->rise_um * expm1(-t_s / p->rise_tau_s);
    for (int i = 0; i < HUM_LINES && p->hum_Hz > 0; i++) {
        double turn = 2 * PI * (i + 1) * p->hum_Hz * t_s;
        x += p->hum_sin_um[i] * sin(turn) + p->hum_cos_um[i] * cos(turn);
    }
    return x;
}

static double curve_um(const struct surroundings_parameters *p, double x_um)
{
    double span = p->high_um - p->low_um, s = (2 * x_um - p->low_um - p->high_um) / span;
    double cubic = 1.5 * sqrt(3.0) * p->cubic;
    return span * ((1 - s * s) * (p->quadratic + cubic * s + 4 * p->quartic * s * s) + p->linear * (1 + s) / 2);
}

double surroundings_sensed_um(struct surroundings *s, double rest_um, double displacement_um, double t_s,
                              struct noise *noise, const struct ziggurat *table)
{
    const struct surroundings_parameters *p = s->with;
    double x = rest_um + displacement_um * (1 + p->gain);
    double speed = (x - (t_s > 0 ? s->before_um : x)) / s->step_s;
    s->before_um = x;
    if (p->quadratic != 0 || p->cubic != 0 || p->quartic != 0 || p->linear != 0)
        x += curve_um(p, x);
    if (p->jitter_s > 0)
        x += p->jitter_s * noise_gaussian(noise, table) * speed;
    x += room_um(p, t_s);
    if (p->vibration_um_rms > 0)
        x += vibration_um(s, noise, table);
    x += p->noise_um_rms * noise_gaussian(noise, table);
    return p->lsb_um > 0 ? p->lsb_um * floor(x / p->lsb_um + 0.5) : x;
}
