#include "core/feedforward.h"

#include "core/fixed.h"

#define RANGE_NODE_BITS 6
#define F_NODE_BITS 4
_Static_assert(FF_RANGE_NODES == (1 << RANGE_NODE_BITS) + 1, "nodes are counted in powers of two");
_Static_assert(FF_FREQUENCY_NODES == (1 << F_NODE_BITS) + 1, "nodes are counted in powers of two");

struct place { /* between two nodes */
    uint32_t node, fraction_q30;
};

/* distance x 1/width is at most 1, so the 64-bit product cannot overflow. */
static struct place locate(uint32_t distance, uint64_t inverse_q63, unsigned node_bits)
{
    uint64_t share_q63 = distance * inverse_q63;
    struct place place = {(uint32_t)(share_q63 >> (63 - node_bits)),
                          (uint32_t)(share_q63 >> (33 - node_bits)) & ((1u << 30) - 1)};
    if (place.node >> node_bits != 0) /* the far end */
        place = (struct place){(1u << node_bits) - 1, 1u << 30};
    return place;
}

static int32_t between(const int32_t *nodes, struct place place)
{
    return lerp_i32(nodes[place.node], nodes[place.node + 1], place.fraction_q30);
}

bool feedforward_lookup(const struct feedforward_tables *tables, int32_t range_q16, int32_t f_q16,
                        struct feedforward_point *point)
{
    if (range_q16 < tables->range_min_q16 || range_q16 > tables->range_max_q16 || f_q16 < tables->f_min_q16 ||
        f_q16 > tables->f_max_q16)
        return false;
    struct place range =
        locate((uint32_t)range_q16 - (uint32_t)tables->range_min_q16, tables->range_inverse_q63, RANGE_NODE_BITS);
    struct place f = locate((uint32_t)f_q16 - (uint32_t)tables->f_min_q16, tables->f_inverse_q63, F_NODE_BITS);
    point->inverse_gain_q28 = between(tables->inverse_gain_q28, range);
    point->lead_turn32 = lerp_i32(between(tables->lead_turn32[f.node], range),
                                  between(tables->lead_turn32[f.node + 1], range), f.fraction_q30);
    return true;
}

int32_t feedforward_static_q24(const struct feedforward_tables *tables, int32_t position_q16)
{
    uint32_t distance_q16 = (uint32_t)magnitude_i64(position_q16);
    int32_t u_q24;
    if (distance_q16 <= (uint32_t)tables->range_min_q16)
        u_q24 = (int32_t)round_shift_i64((int64_t)distance_q16 * tables->inverse_gain_q28[0], 20);
    else if (distance_q16 >= (uint32_t)tables->range_max_q16)
        u_q24 = tables->swing_q24[FF_RANGE_NODES - 1];
    else
        u_q24 = between(tables->swing_q24, locate(distance_q16 - (uint32_t)tables->range_min_q16,
                                                  tables->range_inverse_q63, RANGE_NODE_BITS));
    return position_q16 < 0 ? -u_q24 : u_q24;
}

int32_t feedforward_step_q24(const struct feedforward_point *point, int32_t position_ahead_q16, bool *saturated)
{
    return mul_shift_i32(position_ahead_q16, point->inverse_gain_q28, 20, saturated);
}
