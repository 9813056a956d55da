#include "linked.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct axis {
    const struct linked_axis_parameters *with;
    struct operator_state operator;
    struct link link[LINKED_LINKS], sensor_link[LINKED_SENSOR_LINKS], coupled;
    struct link_parameters coupled_with;
    struct surroundings surroundings;
    struct noise noise;
    int32_t dac_code;
    bool still;      /* nothing has moved it yet */
    double drive_V;  /* of the present code */
    double *sent_V;  /* ring of ticks */
    size_t ring;     /* its length */
    size_t whole;    /* substeps of the delay */
    double part;     /* of one more */
    double force_um; /* of what pushes it */
    double moved_um; /* its own displacement */
    double total_um, sensed_um;
};

struct linked {
    struct linked_parameters with;
    struct axis axes[LINKED_AXES];
    struct ziggurat ziggurat;
    uint64_t tick;
};

static bool links_make(struct link *link, const struct link_parameters *from, uint32_t count, struct axis *axis,
                       double step_s)
{
    double rest = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (!link_make(&link[i], &from[i], &axis->operator, step_s, rest))
            return false;
        rest = link[i].out;
    }
    return true;
}

/* A voltage that changes within a substep enters as the substep's mean and is drawn to its end by a straight line:
 * half a substep late, which is taken off the delay. */
static bool delay_make(struct axis *axis, double step_s)
{
    double substeps = axis->with->delay_s / step_s - 0.5;
    if (!(substeps >= 0 && substeps < 1e8))
        return false;
    axis->whole = (size_t)floor(substeps);
    axis->part = substeps - (double)axis->whole;
    axis->ring = axis->whole / LINK_SUBSTEPS + 3;
    axis->sent_V = calloc(axis->ring, sizeof(double));
    return axis->sent_V != NULL;
}

static bool axis_make(struct axis *axis, const struct linked_axis_parameters *from, double tick_s,
                      const struct ziggurat *table)
{
    double step_s = tick_s / LINK_SUBSTEPS;
    axis->with = from;
    axis->dac_code = -1;
    axis->still = true;
    if (from->links > LINKED_LINKS || from->sensor_links > LINKED_SENSOR_LINKS || from->operator.plays > LINK_PLAYS ||
        from->operator.deadzones > LINK_DEADZONES)
        return false;
    axis->coupled_with.kind = LINK_POLES_SUM;
    axis->coupled_with.number[0] = from->from_lag_s > 0 ? 0 : 1;
    if (from->from_lag_s > 0) {
        axis->coupled_with.poles = 1;
        axis->coupled_with.pole_re[0] = -1 / from->from_lag_s;
        axis->coupled_with.weight_re[0] = 1;
    }
    axis->operator.with = &from->operator;
    surroundings_make(&axis->surroundings, &from->surroundings, tick_s, &axis->noise, table);
    return delay_make(axis, step_s) && links_make(axis->link, from->link, from->links, axis, step_s) &&
           links_make(axis->sensor_link, from->sensor_link, from->sensor_links, axis, step_s) &&
           links_make(&axis->coupled, &axis->coupled_with, 1, axis, step_s);
}

struct linked *linked_open(const struct linked_parameters *parameters)
{
    struct linked *linked = calloc(1, sizeof *linked);
    if (!linked)
        return NULL;
    linked->with = *parameters;
    ziggurat_fill(&linked->ziggurat);
    for (unsigned i = 0; i < LINKED_AXES; i++) {
        noise_seed(&linked->axes[i].noise, parameters->seed, i);
        if (!axis_make(&linked->axes[i], &linked->with.axes[i], parameters->tick_s, &linked->ziggurat)) {
            linked_close(linked);
            return NULL;
        }
    }
    return linked;
}

void linked_close(struct linked *linked)
{
    for (int i = 0; linked && i < LINKED_AXES; i++)
        free(linked->axes[i].sent_V);
    free(linked);
}

void linked_sample(struct linked *linked, double sensed_um[LINKED_AXES], double true_um[LINKED_AXES])
{
    double t_s = (double)linked->tick * linked->with.tick_s;
    for (int i = 0; i < LINKED_AXES; i++) {
        struct axis *axis = &linked->axes[i];
        double rest_um = axis->operator.rest_um + axis->with->offset_um;
        true_um[i] = rest_um + axis->total_um;
        sensed_um[i] =
            surroundings_sensed_um(&axis->surroundings, rest_um, axis->sensed_um, t_s, &axis->noise, &linked->ziggurat);
    }
}

/* By the end-point method: 0 at the first code and at the last. */
static double converter_error_V(const struct linked_axis_parameters *p, uint16_t code)
{
    double share = code / 65535.0, lsb = p->dac_bow_LSB * 4 * share * (1 - share);
    for (int i = 0; i < LINKED_TOP_BITS; i++)
        lsb += p->dac_bit_LSB[i] * ((code >> (15 - i) & 1) - share);
    return lsb * p->dac_V_per_code;
}

static void latch(struct axis *axis, uint16_t code, uint64_t tick)
{
    if (code != axis->dac_code) {
        const struct linked_axis_parameters *p = axis->with;
        double u_V = (code - p->dac_zero_code) * p->dac_V_per_code;
        axis->dac_code = code;
        uint16_t zero = (uint16_t)fmin(fmax(round(p->dac_zero_code), 0), 65535);
        axis->drive_V = u_V + converter_error_V(p, code) - converter_error_V(p, zero);
    }
    axis->sent_V[tick % axis->ring] = axis->drive_V;
}

/* The voltage that was sent `back` substeps before substep `now`; 0 V before the first. */
static double sent_V(const struct axis *axis, uint64_t now, size_t back)
{
    return back > now ? 0 : axis->sent_V[(now - back) / LINK_SUBSTEPS % axis->ring];
}

static void move(struct axis *axis, uint64_t now)
{
    double u_V = (1 - axis->part) * sent_V(axis, now, axis->whole) + axis->part * sent_V(axis, now, axis->whole + 1);
    if (axis->still && u_V == 0)
        return;
    axis->still = false;
    double x = u_V;
    for (uint32_t i = 0; i < axis->with->links; i++) {
        x = link_step(&axis->link[i], x);
        if (axis->force_um != 0 && axis->with->link[i].kind == LINK_OPERATOR)
            x += axis->force_um;
    }
    axis->moved_um = x;
}

static void sense(struct linked *linked, int row)
{
    struct axis *axis = &linked->axes[row];
    if (linked->axes[0].still && linked->axes[1].still && linked->axes[2].still)
        return;
    double through_matrix = 0, beside = 0;
    for (int j = 0; j < LINKED_AXES; j++) {
        through_matrix += linked->with.coupling[row][j] * linked->axes[j].moved_um;
        beside += axis->with->from_um_per_um[j] * linked->axes[j].moved_um;
    }
    axis->total_um = through_matrix + link_step(&axis->coupled, beside);
    axis->sensed_um = axis->total_um;
    for (uint32_t i = 0; i < axis->with->sensor_links; i++)
        axis->sensed_um = link_step(&axis->sensor_link[i], axis->sensed_um);
}

void linked_push(struct linked *linked, unsigned axis, double um)
{
    linked->axes[axis].force_um = um;
    linked->axes[axis].still = false;
}

void linked_drive(struct linked *linked, const uint16_t dac_codes[LINKED_AXES])
{
    for (int i = 0; i < LINKED_AXES; i++)
        latch(&linked->axes[i], dac_codes[i], linked->tick);
    for (unsigned s = 0; s < LINK_SUBSTEPS; s++) {
        for (int i = 0; i < LINKED_AXES; i++)
            move(&linked->axes[i], linked->tick * LINK_SUBSTEPS + s);
        for (int i = 0; i < LINKED_AXES; i++)
            sense(linked, i);
    }
    linked->tick++;
}
