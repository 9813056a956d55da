#include "link.h"

#include <complex.h>
#include <math.h>
#include <string.h>

#define SLEW_HALVINGS 50 /* to 1e-15 of the largest rate */

static double clamp(double x, double low, double high)
{
    return x < low ? low : x > high ? high : x;
}

static double square_of(const struct operator_parameters *p, double u_V)
{
    double q = (2 * u_V - p->low_V - p->high_V) / (p->high_V - p->low_V);
    return q * q;
}

/* Curvature, and plays of the squared voltage whose lag sits at one end of the loop. */
static double asymmetry_um(struct operator_state *o, double u_V)
{
    const struct operator_parameters *p = o->with;
    if (p->bend_um == 0 && p->skew_um == 0)
        return 0;
    double q = square_of(p, u_V), lag = 0, opening = 0;
    for (int i = 0; i < LINK_RING_PLAYS; i++) {
        double r = p->skew_reach * (i + 1) / LINK_RING_PLAYS;
        o->square_play[i] = clamp(o->square_play[i], q - r, q + r);
        lag += o->square_play[i] - q;
        opening += 2 * r;
    }
    return p->bend_um * (q - square_of(p, 0)) + p->skew_um * lag / opening;
}

/* What friction that comes to its level little by little takes off the way, from the last field on. */
static double fading_um(struct operator_state *o, double v)
{
    const struct operator_parameters *p = o->with;
    double way_V = v - o->at_V, x = 0;
    for (uint32_t i = 0; i < p->fading; i++) {
        double share = exp(-fabs(way_V) / (2 * p->fading_r_V[i])), side = (way_V > 0) - (way_V < 0);
        o->turned[i] = share * o->turned[i] + (1 - share) * side;
        x -= p->fading_w_um_per_V[i] * p->fading_r_V[i] * (o->turned[i] - p->fading_start);
    }
    o->at_V = v;
    return x;
}

/* What the field has more than the voltage; straight on beyond the ends of the range. */
static double bent_V(const struct operator_parameters *p, double u_V)
{
    double half = (p->high_V - p->low_V) / 2, s = (u_V - p->low_V) / half - 1, inside = clamp(s, -1, 1);
    return p->field_bend * half * inside * (2 * s - inside);
}

static double field_V(const struct operator_parameters *p, double u_V)
{
    return u_V + bent_V(p, u_V) - bent_V(p, 0);
}

/* The weight of all levels up to v, from the middle of the range on; beyond its ends that of the end goes on. */
static double passed_V(const struct operator_parameters *p, double v)
{
    double low = field_V(p, p->low_V), half = (field_V(p, p->high_V) - low) / 2, s = (v - low) / half - 1;
    double in = clamp(s, -1, 1), weight = 1 + p->play_tilt * in - p->play_taper * in * in;
    return half * (in + p->play_tilt * in * in / 2 - p->play_taper * in * in * in / 3 + weight * (s - in));
}

static double play_um(const struct operator_state *o, uint32_t i)
{
    const struct operator_parameters *p = o->with;
    return p->play_w_um_per_V[i] * (i < p->uneven ? passed_V(p, o->play[i]) - passed_V(p, 0) : o->play[i]);
}

static double operator_um(struct operator_state *o, double u_V)
{
    const struct operator_parameters *p = o->with;
    double v = field_V(p, u_V), x = p->gain_um_per_V * v;
    for (uint32_t i = 0; i < p->plays; i++) {
        o->play[i] = clamp(o->play[i], v - p->play_r_V[i], v + p->play_r_V[i]);
        x += play_um(o, i);
    }
    for (uint32_t i = 0; i < p->deadzones; i++)
        x += v > p->deadzone_d_V[i] ? p->deadzone_s_um_per_V[i] * (v - p->deadzone_d_V[i]) : 0;
    return x + asymmetry_um(o, u_V) + fading_um(o, v);
}

static void operator_rest(struct operator_state *o, double rest_V)
{
    const struct operator_parameters *p = o->with;
    for (uint32_t i = 0; i < p->plays; i++)
        o->play[i] = field_V(p, rest_V) + p->play_start_V[i]; /* a rail keeps the voltage at the material off 0 */
    for (int i = 0; i < LINK_RING_PLAYS; i++)
        o->square_play[i] = square_of(p, rest_V);
    for (uint32_t i = 0; i < p->fading; i++)
        o->turned[i] = p->fading_start;
    o->at_V = field_V(p, rest_V);
    o->rest_um = operator_um(o, rest_V);
}

static bool poles_make(struct link *link)
{
    const struct link_parameters *p = link->with;
    for (uint32_t i = 0; i < p->poles; i++) {
        double complex pole = p->pole_re[i] + I * p->pole_im[i];
        if (!(p->pole_re[i] < 0))
            return false;
        double complex decay = cexp(pole * link->step_s), behind = -1 / (pole * link->step_s);
        link->decay_re[i] = creal(decay);
        link->decay_im[i] = cimag(decay);
        link->behind_re[i] = creal(behind); /* a ramp is followed by so many steps too late */
        link->behind_im[i] = cimag(behind);
    }
    return true;
}

bool link_make(struct link *link, const struct link_parameters *from, struct operator_state *operator, double step_s,
               double rest)
{
    memset(link, 0, sizeof *link);
    link->with = from;
    link->operator = operator;
    link->step_s = step_s;
    link->rest = link->in = link->out = rest;
    link->drive = link->held = rest;
    switch (from->kind) {
    case LINK_POLES_SUM:
        return from->poles <= LINK_POLES && poles_make(link);
    case LINK_CLIP:
        link->out = clamp(rest, from->number[0], from->number[1]);
        return true;
    case LINK_OPERATOR:
        operator_rest(operator, rest);
        link->out = 0;
        return true;
    default:
        for (int i = 0; i < LINK_SUBSTEPS; i++)
            link->recent[i] = rest;
        return from->kind <= LINK_STIFFNESS || (from->kind == LINK_CROSSOVER && from->number[1] > 0);
    }
}

static double poles_step(struct link *link, double x)
{
    const struct link_parameters *p = link->with;
    double before = link->in - link->rest, now = x - link->rest, rise = now - before, sum = p->number[0] * now;
    for (uint32_t i = 0; i < p->poles; i++) {
        double lag_re = link->behind_re[i] * rise, lag_im = link->behind_im[i] * rise;
        double far_re = link->state_re[i] - before + lag_re, far_im = link->state_im[i] + lag_im;
        link->state_re[i] = now - lag_re + link->decay_re[i] * far_re - link->decay_im[i] * far_im;
        link->state_im[i] = -lag_im + link->decay_re[i] * far_im + link->decay_im[i] * far_re;
        sum += p->weight_re[i] * link->state_re[i] - p->weight_im[i] * link->state_im[i];
    }
    return link->rest + sum;
}

/* The level follows by the midpoint rule: it is hundreds of substeps slow. */
static double softening_step(struct link *link, double x)
{
    const double *n = link->with->number;
    double z = x / n[1], share = -expm1(-link->step_s / n[2]);
    link->mean += share * (0.5 * (z + link->in / n[1]) - link->mean);
    z -= n[3] * link->mean;
    link->level += share * (z * z - link->level);
    return x + n[0] * n[1] * z * pow(link->level, n[4] / 2);
}

/* The rate is the mean over the last tick: a converter's stairs have no rate of their own. */
static double friction_step(struct link *link, double x)
{
    const double *n = link->with->number;
    double before = link->recent[link->now], moved = fabs(x - link->in) / n[0];
    link->recent[link->now] = x;
    link->now = (link->now + 1) % LINK_SUBSTEPS;
    double rate = fabs(x - before) / n[0] / (link->step_s * LINK_SUBSTEPS) / n[2];
    double level = n[3] * log10(1 + rate) - n[4] * (1 - exp(-rate)) + n[5];
    double towards = x > link->in ? level : -level;
    link->drag = towards + (link->drag - towards) * exp(-moved / n[1]);
    return x - 0.5 * n[0] * link->drag;
}

/* What goes in less tau times the rate at which the drive leaves what is held. The loop is a lag of the drive while
 * that is held, and of what is held while it follows; a substep that begins in one and ends in the other is cut there.
 */
static double crossover_step(struct link *link, double x)
{
    const double *n = link->with->number;
    double aim = 0.5 * (x + link->in), off = link->drive - link->held, left = link->step_s;
    double drive = link->drive + (aim - link->held) * left / n[1];
    double edge = aim > link->held ? n[0] : -n[0];
    if (fabs(drive - link->held) > n[0]) {
        left -= (link->held + edge - link->drive) / (aim - link->held) * n[1];
        link->held = aim + (link->held - aim) * exp(-left / n[1]);
        drive = link->held + edge;
    }
    link->drive = drive;
    return aim - n[1] * (drive - link->held - off) / link->step_s;
}

/* The part p of the largest rate at which x - y = tau (R artanh(p) - dy/dt) holds at the end of the substep, by
 * halving: what is sought rises with p. Beyond its reach p is 1 but for rounding. */
static double slew_step(const struct link *link, double x)
{
    const double *n = link->with->number;
    double off = x - link->out, way = n[0] * link->step_s, soft = n[0] * n[1], low = 0, high = 1;
    if (soft == 0)
        return link->out + clamp(off, -way, way);
    for (int i = 0; i < SLEW_HALVINGS; i++) {
        double p = 0.5 * (low + high);
        if (way * p + soft * (atanh(p) - p) < fabs(off))
            low = p;
        else
            high = p;
    }
    return link->out + copysign(way * low, off);
}

double link_step(struct link *link, double x)
{
    const double *n = link->with->number;
    switch (link->with->kind) {
    case LINK_POLES_SUM:
        link->out = poles_step(link, x);
        break;
    case LINK_SLEW:
        link->out = slew_step(link, x);
        break;
    case LINK_CLIP:
        link->out = clamp(x, n[0], n[1]);
        break;
    case LINK_OPERATOR:
        link->out = operator_um(link->operator, x) - link->operator->rest_um;
        break;
    case LINK_SOFTENING:
        link->out = softening_step(link, x);
        break;
    case LINK_BACKLASH:
        link->out = clamp(link->out, x - n[0], x + n[0]);
        break;
    case LINK_FRICTION:
        link->out = friction_step(link, x);
        break;
    case LINK_CROSSOVER:
        link->out = crossover_step(link, x);
        break;
    default: /* LINK_STIFFNESS, as link_make() has seen to */
        link->out = x + x * (x / n[0]) * (n[1] + n[2] * (x / n[0]));
    }
    link->in = x;
    return link->out;
}
