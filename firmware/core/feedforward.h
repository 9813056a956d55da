/* The paper's feed-forward (Xu & Li 2010, eq. 11): the desired position, seen early by the phase lead and divided by
 * the gain.
 *
 * K(um), theta(um, f) are given on the voltage swing; a path asks for a position range R. feedforward_expand() of
 * feedforward_tables.h solves K(um) um = R on a grid of R and tabulates 1/K and theta there, once, when a model is
 * committed. Nothing here divides or solves.
 *
 * At its nodes a table is exact to: um, half an LSB of q24 (in K(um) um); 1/K, 0.51 LSB of q28 and what the rounding of
 * K to (2 + um) LSB of q32 makes of it; theta, 0.51 + (1 + um + 2 f)/256 LSB of turn32. Between nodes it is the
 * straight line, within 2 LSB: for Table I that is 4e-4 of K at worst (at the smallest range; 4e-5 at 60 um) and 0.002
 * degrees. feedforward_step_q24() is exactly the nearest value of its product.
 */
#ifndef PHASELEAD_CORE_FEEDFORWARD_H
#define PHASELEAD_CORE_FEEDFORWARD_H

#include <stdbool.h>
#include <stdint.h>

#define FF_RANGE_NODES 65
#define FF_FREQUENCY_NODES 17

struct feedforward_tables {
    int32_t range_min_q16, range_max_q16; /* K(um) um at the ends of the rectangle */
    int32_t f_min_q16, f_max_q16;
    uint64_t range_inverse_q63; /* 1 / (range_max - range_min): times a distance, the share of the rectangle */
    uint64_t f_inverse_q63;
    int32_t swing_q24[FF_RANGE_NODES];        /* um that gives the node's range */
    int32_t inverse_gain_q28[FF_RANGE_NODES]; /* V/um */
    int32_t lead_turn32[FF_FREQUENCY_NODES][FF_RANGE_NODES];
};

struct feedforward_point { /* the tables at one range and frequency */
    int32_t inverse_gain_q28;
    int32_t lead_turn32;
};

/* False when (range, f) lies outside the identified rectangle. */
bool feedforward_lookup(const struct feedforward_tables *tables, int32_t range_q16, int32_t f_q16,
                        struct feedforward_point *point);

/* Voltage for a position that is held or passed slowly: the um whose K(um) um is this position, by the table; straight
 * to zero below its first node, clamped at its last. Odd in the position (negative positions mirror). */
int32_t feedforward_static_q24(const struct feedforward_tables *tables, int32_t position_q16);

/* position / K. */
int32_t feedforward_step_q24(const struct feedforward_point *point, int32_t position_ahead_q16, bool *saturated);

#endif
