#include "plant.h"

#include "dynamics.h"
#include "noise.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct hysteresis {
    uint32_t plays, deadzones;
    double gain, rest_um; /* its value at rest; displacements count from there */
    double r[PLANT_PLAYS], w[PLANT_PLAYS], p[PLANT_PLAYS];
    double d[PLANT_DEADZONES], s[PLANT_DEADZONES];
};

struct axis {
    struct hysteresis hysteresis;
    struct dynamics dynamics;
    struct noise noise;
    double dac_zero, V_per_code;
    double x_min_um, codes_per_um, code_max, noise_um;
    unsigned sensor;      /* which of the distinct sensor corners this axis has */
    unsigned whole_ticks; /* of the delay */
    int32_t dac_code;     /* of the last tick; -1: none yet */
    double rest_um;       /* where the sensor stands at rest; the rest is displacement from there */
    double displacement_um;
    double on_the_way_um[PLANT_DELAY_TICKS];
    double arrived;  /* what drives the dynamics now, um */
    double force_um; /* of what pushes the stage now */
};

struct force {
    uint64_t tick;
    unsigned axis;
    double um;
};

struct plant {
    double coupling[PLANT_AXES][PLANT_AXES];
    struct axis axes[PLANT_AXES];
    struct linked *linked; /* not NULL: it is the stage */
    struct ziggurat ziggurat;
    uint64_t tick, sampled;
    struct force forces[PLANT_FORCES]; /* still to come */
    unsigned force_count;
    double *trace_um;
    size_t trace_capacity, trace_count;
};

/* The operator of a stage file's time view; play_i follows u within +-r_i. */
static double hysteresis_um(struct hysteresis *h, double u_V)
{
    double x = h->gain * u_V;
    for (uint32_t i = 0; i < h->plays; i++) {
        double low = u_V - h->r[i], high = u_V + h->r[i], p = h->p[i];
        p = p < low ? low : p;
        p = p > high ? high : p;
        h->p[i] = p;
        x += h->w[i] * p;
    }
    for (uint32_t i = 0; i < h->deadzones; i++) {
        double over = u_V - h->d[i];
        x += h->s[i] * (over > 0 ? over : 0);
    }
    return x;
}

static bool hysteresis_make(struct hysteresis *h, const struct plant_axis_parameters *from)
{
    if (from->plays > PLANT_PLAYS || from->deadzones > PLANT_DEADZONES)
        return false;
    h->plays = from->plays;
    h->deadzones = from->deadzones;
    h->gain = from->gain_um_per_V;
    memcpy(h->r, from->play_r_V, sizeof h->r);
    memcpy(h->w, from->play_w_um_per_V, sizeof h->w);
    memcpy(h->p, from->play_start_V, sizeof h->p);
    memcpy(h->d, from->deadzone_d_V, sizeof h->d);
    memcpy(h->s, from->deadzone_s_um_per_V, sizeof h->s);
    h->rest_um = hysteresis_um(h, 0);
    return true;
}

static unsigned find_corners(const struct plant_parameters *from, double *corners, struct plant *plant)
{
    unsigned count = 0;
    for (int i = 0; i < PLANT_AXES; i++) {
        unsigned at = 0;
        while (at < count && corners[at] != from->axes[i].sensor_corner_Hz)
            at++;
        if (at == count)
            corners[count++] = from->axes[i].sensor_corner_Hz;
        plant->axes[i].sensor = at;
    }
    return count;
}

static bool axis_make(struct axis *axis, const struct plant_axis_parameters *from, double tick_s,
                      const double *corners_Hz, unsigned corners)
{
    if (from->creeps > PLANT_CREEPS || from->modes > PLANT_MODES || !(from->delay_ticks >= 0) ||
        !(from->delay_ticks < PLANT_DELAY_TICKS))
        return false;
    axis->dac_zero = from->dac_zero_code;
    axis->V_per_code = from->dac_V_per_code;
    axis->x_min_um = from->adc_x_min_um;
    axis->codes_per_um = from->adc_codes_per_um;
    axis->code_max = from->adc_code_max;
    axis->noise_um = from->noise_um_rms;
    axis->dac_code = -1;
    axis->whole_ticks = (unsigned)floor(from->delay_ticks);
    if (!hysteresis_make(&axis->hysteresis, from) ||
        !dynamics_make(&axis->dynamics, from, tick_s, from->delay_ticks - axis->whole_ticks, corners_Hz, corners))
        return false;
    axis->rest_um = axis->hysteresis.rest_um + from->offset_um;
    return true;
}

struct plant *plant_open(const struct plant_parameters *parameters)
{
    struct plant *plant = calloc(1, sizeof *plant);
    double corners_Hz[PLANT_AXES];
    if (!plant)
        return NULL;
    ziggurat_fill(&plant->ziggurat);
    memcpy(plant->coupling, parameters->coupling, sizeof plant->coupling);
    unsigned corners = find_corners(parameters, corners_Hz, plant);
    for (unsigned i = 0; i < PLANT_AXES; i++) {
        noise_seed(&plant->axes[i].noise, parameters->seed, i);
        if (!axis_make(&plant->axes[i], &parameters->axes[i], parameters->tick_s, corners_Hz, corners)) {
            free(plant);
            return NULL;
        }
    }
    if (parameters->linked) {
        plant->linked = linked_open(parameters->linked);
        if (!plant->linked) {
            free(plant);
            return NULL;
        }
    }
    return plant;
}

void plant_close(struct plant *plant)
{
    if (plant) {
        free(plant->trace_um);
        linked_close(plant->linked);
    }
    free(plant);
}

size_t plant_parameters_size(void)
{
    return sizeof(struct plant_parameters);
}

size_t plant_linked_parameters_size(void)
{
    return sizeof(struct linked_parameters);
}

static uint16_t sensor_code(const struct axis *axis, double x_um)
{
    double code = (x_um - axis->x_min_um) * axis->codes_per_um + 0.5;
    if (!(code > 0))
        return 0;
    return code >= axis->code_max ? (uint16_t)axis->code_max : (uint16_t)code;
}

static void true_positions(const struct plant *plant, double x_um[PLANT_AXES])
{
    double own[PLANT_AXES];
    for (int j = 0; j < PLANT_AXES; j++)
        own[j] = dynamics_output(&plant->axes[j].dynamics, DYNAMICS_TRUE, plant->axes[j].arrived);
    for (int i = 0; i < PLANT_AXES; i++) {
        x_um[i] = plant->axes[i].rest_um;
        for (int j = 0; j < PLANT_AXES; j++)
            x_um[i] += plant->coupling[i][j] * own[j];
    }
}

static void sensed_positions(struct plant *plant, double x_um[PLANT_AXES])
{
    for (int i = 0; i < PLANT_AXES; i++) {
        struct axis *axis = &plant->axes[i];
        x_um[i] = axis->rest_um + axis->noise_um * noise_gaussian(&axis->noise, &plant->ziggurat);
    }
    for (int j = 0; j < PLANT_AXES; j++) {
        const struct axis *source = &plant->axes[j];
        double seen[PLANT_AXES];
        if (source->dynamics.at_rest)
            continue; /* adds exact zeros */
        for (unsigned k = 0; k < source->dynamics.sensors; k++)
            seen[k] = dynamics_output(&source->dynamics, k, source->arrived);
        for (int i = 0; i < PLANT_AXES; i++)
            x_um[i] += plant->coupling[i][j] * seen[plant->axes[i].sensor];
    }
}

void plant_sample(struct plant *plant, uint16_t adc_codes[PLANT_AXES])
{
    double x_um[PLANT_AXES], true_um[PLANT_AXES] = {0};
    if (plant->linked)
        linked_sample(plant->linked, x_um, true_um);
    else
        sensed_positions(plant, x_um);
    for (int i = 0; i < PLANT_AXES; i++)
        adc_codes[i] = sensor_code(&plant->axes[i], x_um[i]);
    plant->sampled++;
    if (plant->trace_capacity) {
        if (!plant->linked)
            true_positions(plant, true_um);
        memcpy(plant->trace_um + PLANT_AXES * (plant->trace_count++ % plant->trace_capacity), true_um, sizeof true_um);
    }
}

static double delayed(struct axis *axis, uint64_t tick)
{
    if (axis->whole_ticks == 0)
        return axis->displacement_um;
    double *slot = &axis->on_the_way_um[tick % axis->whole_ticks];
    double arriving = *slot;
    *slot = axis->displacement_um;
    return arriving;
}

int plant_push(struct plant *plant, unsigned axis, double um, uint64_t tick)
{
    if (axis >= PLANT_AXES || plant->force_count == PLANT_FORCES || tick < plant->sampled || !isfinite(um))
        return -1;
    plant->forces[plant->force_count++] = (struct force){.tick = tick, .axis = axis, .um = um};
    return 0;
}

static void push(struct plant *plant, uint64_t now)
{
    for (unsigned i = 0; i < plant->force_count; i++) {
        const struct force force = plant->forces[i];
        if (force.tick > now)
            continue;
        plant->axes[force.axis].force_um += force.um;
        if (plant->linked)
            linked_push(plant->linked, force.axis, plant->axes[force.axis].force_um);
        plant->forces[i--] = plant->forces[--plant->force_count];
    }
}

void plant_drive(struct plant *plant, const uint16_t dac_codes[PLANT_AXES])
{
    if (plant->force_count)
        push(plant, plant->sampled - 1);
    if (plant->linked) {
        linked_drive(plant->linked, dac_codes);
        return;
    }
    for (int i = 0; i < PLANT_AXES; i++) {
        struct axis *axis = &plant->axes[i];
        if (dac_codes[i] != axis->dac_code) { /* the operator is rate-independent: the same voltage changes nothing */
            double u_V = (dac_codes[i] - axis->dac_zero) * axis->V_per_code;
            axis->dac_code = dac_codes[i];
            axis->displacement_um = hysteresis_um(&axis->hysteresis, u_V) - axis->hysteresis.rest_um;
        }
        double arriving = delayed(axis, plant->tick);
        if (axis->force_um != 0)
            arriving += axis->force_um;
        if (axis->dynamics.at_rest && arriving == 0)
            continue;
        axis->dynamics.at_rest = false;
        dynamics_step(&axis->dynamics, axis->arrived, arriving);
        axis->arrived = arriving;
    }
    plant->tick++;
}

void plant_run(struct plant *plant, const uint16_t *dac_codes, uint16_t *adc_codes, uint64_t ticks)
{
    for (uint64_t i = 0; i < ticks; i++) {
        plant_sample(plant, adc_codes + PLANT_AXES * i);
        plant_drive(plant, dac_codes + PLANT_AXES * i);
    }
}

int plant_trace(struct plant *plant, size_t capacity)
{
    free(plant->trace_um);
    plant->trace_um = capacity ? calloc(capacity, PLANT_AXES * sizeof(double)) : NULL;
    plant->trace_capacity = plant->trace_um ? capacity : 0;
    plant->trace_count = 0;
    return plant->trace_capacity == capacity ? 0 : -1;
}

size_t plant_take_trace(struct plant *plant, double *positions_um, size_t capacity, uint64_t *first)
{
    size_t kept = plant->trace_count < plant->trace_capacity ? plant->trace_count : plant->trace_capacity;
    size_t count = kept < capacity ? kept : capacity;
    for (size_t i = 0; i < count; i++) {
        size_t row = (plant->trace_count - count + i) % plant->trace_capacity;
        memcpy(positions_um + PLANT_AXES * i, plant->trace_um + PLANT_AXES * row, PLANT_AXES * sizeof(double));
    }
    *first = plant->sampled - count;
    plant->trace_count = 0;
    return count;
}
