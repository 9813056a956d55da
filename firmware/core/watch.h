/* Whether an axis can still be believed: by its sensor's codes, its error, and its output. Pure; run
 * once a tick, after the output. Each finding needs its number of ticks, so that a spike is none.
 */
#ifndef PHASELEAD_CORE_WATCH_H
#define PHASELEAD_CORE_WATCH_H

#include <stdbool.h>
#include <stdint.h>

/* A converter clips at 0 and 65535; a conditioner that saturates stops short of them by the full-scale errors of both:
 * 64 codes are 20 mV of +-10.24 V. */
#define WATCH_RAIL_MARGIN 64
#define WATCH_RAIL_TICKS 3 /* in a row */

#define WATCH_RANGE_TICKS 3 /* in a row beyond the range */

/* A quarter of the sensor's range in a tick of 0.2 ms: a stage that swings over all of its range does so at 500 Hz and
 * more. Three such jumps, each at most WATCH_JUMP_APART ticks after the one before. */
#define WATCH_JUMP_CODES 16384
#define WATCH_JUMPS 3
#define WATCH_JUMP_APART 50

/* The very same code for 20 ms while the output has moved by a sixteenth of its range: noise alone changes a code, and
 * 20 ms are longer than any delay of a stage. */
#define WATCH_FROZEN_TICKS 100
#define WATCH_FROZEN_SHARE_LOG2 4

/* The slew limit or the clamp has cut every output for 0.5 s: the loop is open in effect. */
#define WATCH_LIMITED_TICKS 2500

enum watch_finding {
    WATCH_FINE,
    WATCH_RAIL,
    WATCH_JUMPED,
    WATCH_FROZEN,
    WATCH_ERROR,
    WATCH_LIMITED,
    WATCH_OSCILLATION
};

struct watch_config {
    int32_t error_limit_q16; /* um, either way */
    uint32_t error_ticks;    /* so long in a row beyond it */
    uint32_t u_range_q24;    /* between the limits of the output */
};

struct watch_state {
    uint32_t rail_ticks, error_ticks, limited_ticks; /* in a row */
    uint32_t jumps, calm_ticks;                      /* since the last jump */
    uint32_t same_ticks;                             /* with this code */
    int32_t same_u_q24;                              /* output when it came */
    uint32_t code;
    uint32_t primed;      /* 0: `code` is none yet */
    uint32_t range_ticks; /* in a row outside its range */
    uint32_t padding;
};

struct watch_tick {
    uint16_t adc_code;
    bool limited; /* the output was cut */
    int32_t u_q24, error_q16;
};

enum watch_finding watch_step(const struct watch_config *config, struct watch_state *state,
                              const struct watch_tick *tick);

/* For an axis without feedback: its sensor's codes alone. A rail counts for nothing: where it takes the stage, and
 * whether its sensor reaches that far, is the matter of who drives it. */
enum watch_finding watch_codes(const struct watch_config *config, struct watch_state *state,
                               const struct watch_tick *tick);

/* False when the code was outside [low, high] for WATCH_RANGE_TICKS. */
bool watch_range(struct watch_state *state, uint16_t adc_code, uint32_t low, uint32_t high);

#endif
