/* One path after another without a kick, and those that are still to come.
 *
 * A path is entered by a join: while it lasts the path before runs on, the new one runs already, and what the two ask
 * for is mixed,
 *
 *     r = (1 - w) before + w new,   w = 10 s^3 - 15 s^4 + 6 s^5,   s = 0 .. 1 during the join
 *
 * (w is the polynomial of least jerk, Flash & Hogan 1985: at both ends its first two derivatives are 0). So reference
 * and lead, feed-forward and look-ahead are all faded, acceleration is continuous, and the mix stays between the two
 * paths. A periodic path is begun so much before its phase 0 that it reaches it when the join ends. motion_bounds.h
 * says what velocity, acceleration and jerk a join can come to.
 *
 * Only two paths are mixed at a time: what is due during a join begins when the join has ended. */
#ifndef PHASELEAD_CORE_SEGMENT_H
#define PHASELEAD_CORE_SEGMENT_H

#include <stdbool.h>
#include <stdint.h>

#include "core/feedforward.h"
#include "core/path.h"

#define SEGMENTS_QUEUED 8

struct segment { /* fixed-size fields, no padding: part of the control state that is read back */
    struct path_config path;
    struct feedforward_point point; /* tables at the path's range and frequency */
    uint64_t enter_turn64;          /* 2^64 / enter_ticks, rounded up */
    uint64_t leave_turn64;
    uint64_t begin_tick; /* whatever the path before does then; 0: when that has ended, if it ever does, else at once */
    uint32_t enter_ticks; /* of the join into it; 0: none, it begins where the path before has come to rest */
    uint32_t leave_ticks; /* of the join to a hold where it ends and nothing follows; 0: the lead is dropped */
    uint32_t number;      /* those of one command have the same number, */
    uint32_t together;    /* are for these axes, and begin in the same tick */
};

struct segment_queue {
    struct segment ring[SEGMENTS_QUEUED];
    uint64_t dry_tick; /* of the last path that ended with PATH_MORE and had none after it */
    uint32_t first, count;
    uint32_t dry; /* 1: since the last segment was put */
    uint32_t reserved;
};

struct join_state {          /* of the path that is being left */
    struct path_config path; /* standing: a hold */
    struct feedforward_point point;
    struct path_state state;
    uint64_t phase_turn64; /* share of the join that has passed */
    uint64_t step_turn64;  /* 0: no join is under way */
    int32_t ahead_q16;     /* standing: what the inverse takes the position for, */
    int32_t u_q24;         /* and the output */
    uint32_t standing;     /* 1: no path came before, the axis stood */
    uint32_t wait_ticks;   /* until it begins: meanwhile only a look ahead sees it */
};

/* Puts it last, as one of command `number`. Not when it is full. */
void segment_put(struct segment_queue *queue, const struct segment *segment, uint32_t number);

/* The next one; NULL when there is none. */
const struct segment *segment_first(const struct segment_queue *queue);
/* The last one; NULL when there is none. */
const struct segment *segment_last(const struct segment_queue *queue);
void segment_drop_first(struct segment_queue *queue);
void segment_drop_all(struct segment_queue *queue);
void segment_reset(struct segment_queue *queue);

bool join_is_under_way(const struct join_state *join);
/* How much of the new path there is `ticks_q16` later, 0 .. 2^30. */
uint32_t join_weight_q30(const struct join_state *join, uint32_t ticks_q16);
/* One tick on, with the path that is being left. */
void join_advance(struct join_state *join);

#endif
