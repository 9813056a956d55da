/* How fast a path, or a join of two, can be at most: bounds on the first three derivatives of the reference.
 *
 * In 2^-24 of the path's own unit in the last place per tick, tick^2 and tick^3: um q40, V q48. Rounded up, so that a
 * path that is admitted stays below its limits. Not for the tick.
 *
 *     move by d in n ticks             15/8 d/n      10/sqrt(3) d/n^2    60 d/n^3
 *     sine of swing d, period n        pi d/n        2 pi^2 d/n^2        4 pi^3 d/n^3
 *     waveform                         its steepest piece of line; its corners are not counted
 *     join of A and B in n ticks, between values that are D apart at most:
 *         v <= max(vA, vB) + 15/8 D/n
 *         a <= max(aA, aB) + 2 (15/8) (vA + vB)/n + 10/sqrt(3) D/n^2
 *         j <= max(jA, jB) + 3 (15/8) (aA + aB)/n + 3 (10/sqrt(3)) (vA + vB)/n^2 + 60 D/n^3
 *
 * The constants are the largest derivatives of 10 s^3 - 15 s^4 + 6 s^5; a join is differentiated by the product rule.
 */
#ifndef PHASELEAD_CORE_MOTION_BOUNDS_H
#define PHASELEAD_CORE_MOTION_BOUNDS_H

#include <stdbool.h>
#include <stdint.h>

#include "core/path.h"

struct motion_bounds {
    uint64_t velocity, acceleration, jerk;
};

struct path_span { /* lowest and highest value */
    int64_t low, high;
};

/* Of a path that begins where it says. `steepest_q30`: the largest step between two points of its waveform. */
struct path_span path_span(const struct path_config *config);
struct motion_bounds motion_of_path(const struct path_config *config, uint32_t steepest_q30);

/* Of a move by `way` in 2^64 / step ticks. */
struct motion_bounds motion_of_move(uint64_t way, uint64_t step_turn64);

/* The longest way between a value of one span and a value of the other. */
uint64_t span_apart(const struct path_span *a, const struct path_span *b);

struct motion_bounds motion_of_join(const struct motion_bounds *before, const struct motion_bounds *after,
                                    uint64_t apart, uint64_t step_turn64);

/* A limit of 0 is none. */
bool motion_is_within(const struct motion_bounds *motion, const struct motion_bounds *limits);

/* The largest step between two neighbours of WAVE_POINTS points, the last and the first included. */
uint32_t motion_steepest_q30(const int32_t *wave_q30);

#endif
