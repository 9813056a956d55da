/* The transient recorder: every tick of all axes, always, in a ring in memory; a trigger freezes it a while later, so
 * that what led there can be read. A fault is always a trigger; another one may be chosen. The first one counts.
 *
 * What is frozen stays until it is armed again, or another run is started. Each entry has its tick, so that ticks which
 * were never run (flash was busy) show as a gap.
 */
#ifndef PHASELEAD_APP_TRANSIENT_H
#define PHASELEAD_APP_TRANSIENT_H

#include "app/wire.h"
#include "core/axis.h"

#define TRANSIENT_AXES 3
#define TRANSIENT_ENTRIES 400       /* 80 ms at every tick */
#define TRANSIENT_DEFAULT_AFTER 100 /* 20 ms after the trigger, 60 before */

struct transient_axis {
    int32_t reference;
    uint16_t adc_code, dac_code;
    int16_t feedforward_q11, feedback_q11;
};

struct transient_entry { /* read as it lies in memory */
    uint32_t tick;       /* low half */
    struct transient_axis axis[TRANSIENT_AXES];
};

_Static_assert(sizeof(struct transient_entry) == 4 + 12 * TRANSIENT_AXES, "transient_entry is padded");

struct transient {
    struct wire_transient_arm_request trigger;
    uint8_t state;                 /* enum wire_transient_state */
    uint8_t cause;                 /* enum wire_trigger */
    uint8_t modes[TRANSIENT_AXES]; /* at the trigger */
    uint16_t skip;                 /* ticks to pass before the next entry */
    uint32_t left;                 /* entries until it freezes */
    uint32_t next, count;          /* place of the next entry; those that are filled */
    uint64_t trigger_tick;
    int32_t before; /* value of the threshold's channel in the tick before */
    bool before_is_known;
    struct transient_entry entries[TRANSIENT_ENTRIES];
};

/* False when axis, channel, decimation or the entries after the trigger are not valid. Empties the ring. */
bool transient_arm(struct transient *transient, const struct wire_transient_arm_request *trigger);

/* As from reset on: it waits for a fault. */
void transient_reset(struct transient *transient);

/* With the trigger that was chosen, it waits anew if it is frozen. */
void transient_arm_again(struct transient *transient);

/* One of these happened: in the tick, or while ticks are kept out. The modes of these configurations are noted. */
void transient_trigger(struct transient *transient, enum wire_trigger cause, uint64_t tick,
                       const struct axis_config config[TRANSIENT_AXES]);

/* Every tick, after the output. */
void transient_tick(struct transient *transient, uint64_t tick, const uint16_t adc_codes[TRANSIENT_AXES],
                    const struct axis_trace traces[TRANSIENT_AXES], const struct axis_config config[TRANSIENT_AXES]);

/* Bytes from `offset` on of what is in the ring, oldest first, as many as lie together, at most `*size`. NULL: beyond
 * the end. */
const uint8_t *transient_bytes(const struct transient *transient, uint32_t offset, size_t *size);

#endif
