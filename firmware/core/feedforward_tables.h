/* From the paper's polynomials (Xu & Li 2010, eqs. 8 and 9) to tables, when a model is committed. Never in a tick. */
#ifndef PHASELEAD_CORE_FEEDFORWARD_TABLES_H
#define PHASELEAD_CORE_FEEDFORWARD_TABLES_H

#include "core/feedforward.h"

struct feedforward_model {
    int64_t a_q32[3]; /* um/V, um/V^2, um/V^3 */
    int64_t b_q40[6]; /* turns, per V, per Hz, per V Hz, per V^2, per Hz^2 */
    int32_t swing_min_q24, swing_max_q24;
    int32_t f_min_q16, f_max_q16;
};

enum feedforward_verdict { FF_OK, FF_NOT_MONOTONE, FF_GAIN_OUT_OF_RANGE, FF_RECTANGLE_EMPTY, FF_LEAD_OUT_OF_RANGE };

/* Fills the tables; with any verdict but FF_OK they are not to be used. K within 1/8 .. 4096 um/V, K(um) um rising and
 * below 32768 um on the whole rectangle, the lead within half a turn at every node. Bounded time, integers only. */
enum feedforward_verdict feedforward_expand(const struct feedforward_model *model, struct feedforward_tables *tables);

#endif
