/* What a unit slope of each segment and play adds to the position behind modes, at the rows that count. All in V.
 *
 * A segment or a play either goes with the voltage or stands still. Both are x = goes (v - v in row 0) + level, and
 * which of the two it does changes a few times a period. Between two changes its answer behind a mode is that of the
 * voltage, filtered once for all columns, and a ring that dies away by itself:
 *     state of x = goes (state of v) + level (state of 1) + ring
 * So where the two change, the ring takes up what the other terms jump by. A row costs one step of the filter of v, a
 * row that counts one ring of each column, and there are few changes: a long record of which few rows count costs a
 * small part of what filtering every column would. */
#ifndef PHASELEAD_MODEL_COLUMNS_BEHIND_MODES_H
#define PHASELEAD_MODEL_COLUMNS_BEHIND_MODES_H

#include "effects/filters.h"
#include "operator.h"

/* How many doubles of room the next function needs. */
PHASELEAD_EXPORT size_t stage_room_behind_modes(const struct stage_record *record, const struct stage_basis *basis,
                                                size_t n_modes);

/* As stage_columns, with every column but the last two behind `modes` (filters.h: stage_behind_modes) that rest in row
 * 0. The basis has an even density and no fading plays; its thresholds ascend, and no play at `p` has lost touch with
 * its neighbour; the rows that count ascend strictly. What rings by less than 1e-18 V has died away. Of a mode of a
 * thousandth of the rate rounding leaves some 1e-10 V, and more the slower it is. */
PHASELEAD_EXPORT void stage_columns_behind_modes(const struct stage_record *record, double delay,
                                                 const struct stage_basis *basis, size_t n_modes,
                                                 const struct stage_share *modes, double *p, double *room, double *out);

#endif
