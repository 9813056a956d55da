/* One device: control of three axes, the model, the recorder and the line. A port owns one, makes it (device_init.h),
 * calls device_tick() at TICK_RATE_HZ (device_tick.h) and moves bytes between the line and service.h. Nothing here
 * allocates, blocks or keeps globals.
 */
#ifndef PHASELEAD_APP_DEVICE_H
#define PHASELEAD_APP_DEVICE_H

#include "app/events.h"
#include "app/fault_log.h"
#include "app/journal.h"
#include "app/line.h"
#include "app/model_store.h"
#include "app/recorder.h"
#include "app/supervisor.h"
#include "app/transient.h"
#include "app/update.h"
#include "core/axis.h"
#include "core/extremes.h"
#include "core/motion_bounds.h"
#include "core/trigger.h"

#define AXES 3
#define ALL_AXES ((1u << AXES) - 1)
#define NO_AXIS 255
#define TRIGGERS 3              /* outputs */
#define TRIGGER_EDGE 0x80       /* in the stream, beside a bit for each output */
#define HOST_TIMEOUT_TICKS 5000 /* 1 s until SET_TIMEOUT says otherwise */
#define RAM_BUDGET (120 * 1024) /* of 128 KiB: the port, its stack and the code that runs from RAM take the rest */

/* What is known of a waveform whose points come while it is played (points.h). Fixed-size fields, no padding. */
enum points_standing {
    POINTS_NO_RING,
    POINTS_RING,  /* filled, and not set or queued yet */
    POINTS_PLAYED /* set or queued, since */
};

struct points_ring {
    uint64_t length_ticks; /* of the path; 0: not known yet */
    int32_t first, next;   /* points that have come: from, up to but not */
    uint32_t steepest_q30;
    uint32_t ring; /* enum points_standing */
    uint32_t ticks_log2;
    uint32_t reserved;
};

/* Everything that the next tick depends on, besides model and waveforms: what SNAPSHOT_READ gives and a replay starts
 * from. Fixed-size fields and no hole, so that it is the same bytes in every build. */
struct control {
    uint64_t tick; /* the next one to run; 0 at power-on */
    uint64_t fault_tick;
    uint64_t heard_tick; /* of the last command of the session */
    uint32_t timeout_ticks;
    uint32_t state; /* enum wire_state */
    uint32_t fault; /* enum wire_fault */
    uint32_t fault_axis;
    uint32_t fault_detail;
    uint32_t path_mask;  /* axes that have been given a path since their mode was set */
    uint32_t queued;     /* commands that were: numbers their segments */
    uint32_t pulsing;    /* mask of the trigger outputs that pulse in the next tick */
    uint64_t first_tick; /* STATUS has it */
    struct axis_config config[AXES];
    struct axis_state axis[AXES];
    struct segment_queue queue[AXES];
    struct points_ring points[AXES];
    struct trigger trigger[TRIGGERS];
    uint32_t reserved; /* explicit padding */
};

/* What a port is and can do. `lock` keeps the tick out until `unlock`; both may be NULL where ticks and service never
 * overlap. */
struct device_port {
    struct flash_port flash;     /* of the models */
    struct flash_port records;   /* of the journal */
    struct fault_log *fault_log; /* in memory that a reset leaves as it is */
    struct update_port update;
    void (*lock)(void *context);
    void (*unlock)(void *context);
    /* Takes the codes of a tick as soon as they are known, before the tick is recorded; NULL: device_tick() gives them.
     */
    void (*drive)(void *context, const uint16_t dac_codes[AXES]);
    /* Is told of every command that is carried out, and not of what is refused before or answered from the replies
     * that are kept; may be NULL. */
    void (*obeyed)(void *context, const struct wire_header *header);
    void *context;
    uint32_t baud;
    enum wire_reset_cause reset_cause;
    uint8_t brown_out_level; /* 0: off */
    const char *target;
    uint8_t build_id[20];
};

/* What the points of a waveform were learned with, as in WAVE_COMMIT; 0: they are for any model, or any path. */
struct learned_for {
    uint32_t model_crc, path_crc;
};

/* What an axis has been through, in the memory of a model that is to come. */
struct recalled {
    struct inverse_state inverse;
    bool creep; /* the same terms: what creeps goes on */
};

struct device {
    struct control control;
    struct device_port port;
    uint64_t session;              /* 0: none yet */
    bool host_is_recorded;         /* a replay: whether the host lived is in the recording */
    _Atomic uint32_t raised;       /* faults a port has detected, bit by enum wire_fault: taken up by the next tick */
    _Atomic uint32_t raised_first; /* of them; enum wire_fault */
    uint32_t cycles_last, cycles_max, cycles_histogram[16], overruns, latched_late; /* kept by the port */
    uint32_t lost_ticks;
    uint32_t last_fault, last_fault_detail;
    uint16_t adc_codes[AXES], dac_codes[AXES];
    struct axis_trace traces[AXES]; /* of the last tick */
    _Atomic uint32_t path_done;     /* axes whose path has ended, at these ticks: for device_put_path_events() */
    uint64_t path_done_tick[AXES];
    bool trigger_edge; /* an edge has come at the trigger input since the last tick */
    uint32_t resting;  /* axes that need no step: it would change nothing, and their trace stays valid */
    struct model_store models;
    struct update update;
    struct journal journal;
    struct axis_config idle[AXES];    /* what axes begin with: device_make_idle(). No tick reads them */
    struct axis_model model_of[AXES]; /* what a tick works with: device_link_models() */
    uint32_t wave_mask;               /* axes with a whole waveform */
    struct learned_for wave_for[AXES];
    int32_t waves_q30[AXES][WAVE_POINTS];
    uint32_t wave_steepest_q30[AXES];
    struct motion_bounds motion_limits[AXES]; /* of what is queued */
    struct segment asked[AXES];               /* by QUEUE, while it checks them: the stack is small */
    struct recalled recalled[AXES];           /* by MODEL_COMMIT, likewise */
    struct extremes driven[AXES];             /* since the start: for the first model that has an inverse */
    struct control latched;                   /* at the last STREAM_START */
    bool latched_valid;
    struct events events;
    struct recorder recorder;
    struct transient transient;
    struct line line;
    struct {
        uint32_t axis, detail;
    } raised_as[WIRE_FAULT_COUNT]; /* what goes with each fault of `raised` */
};

_Static_assert(sizeof(struct control) == 64 +
                                             AXES * (sizeof(struct axis_config) + sizeof(struct axis_state) +
                                                     sizeof(struct segment_queue) + sizeof(struct points_ring)) +
                                             TRIGGERS * sizeof(struct trigger) + 4,
               "control is padded");
_Static_assert(sizeof(struct device) <= RAM_BUDGET, "the device no longer fits the smallest board");

static inline bool is_in(uint32_t mask, unsigned axis)
{
    return (mask >> axis & 1u) != 0;
}

/* Modes idle, no gains, no paths; limits and converters of the model, or the defaults. Where a ramp goes stays as it
 * was: 0 V from reset on, until device_take_safe_values(). */
void device_reset_axes(struct device *device);

/* From now on a ramp goes to the safe values of the model. For ARM alone: nothing moves before it. */
void device_take_safe_values(struct device *device);

/* What axes are to begin with: the limits, converters and safe values of a model, or without one (NULL) the defaults,
 * held to hard limits. Divides: not to be done while ticks are kept out. */
void device_make_idle(struct device *device, const struct model_slot *slot, const struct wire_axis_limits limits[AXES]);

/* The same of the active model and the limits that are kept: after others were tried and refused. */
void device_make_idle_again(struct device *device);

/* Whether outputs and safe values are within the limits that axes are to begin with. */
bool device_admits(const struct device *device);

/* The axes begin anew with them; nothing moves by itself. In a fault they go on doing what its reaction was. */
void device_begin_idle(struct device *device);

/* Sets the memory of the active model to that of a stage at rest at 0 V whose voltages then went to where they are:
 * after a start. */
void device_rest(struct device *device);

/* To be called after anything but a tick has changed the configuration or the state of an axis. */
void device_wake(struct device *device, unsigned axis);

/* To be called after a model or a waveform was loaded or dropped. */
void device_link_models(struct device *device);

uint8_t device_at_rest_mask(const struct device *device);

/* Whether every output is at its safe value or held, while ticks are kept out. Parked is not enough: a ramp to the safe
 * value may be under way. Until the next command only a fault makes outputs move that stand still. */
bool device_stands_still(const struct device *device);

/* Busy while it does not, else ok. Keeps ticks out by itself. */
enum wire_status device_wants_still(const struct device *device);

/* NULL when the axis has no table view. */
const struct feedforward_tables *device_tables(const struct device *device, unsigned axis);
/* NULL when the axis has no time view that can be inverted. */
const struct compensation *device_compensation(const struct device *device, unsigned axis);
/* NULL when the axis has no whole waveform. */
const int32_t *device_wave_q30(const struct device *device, unsigned axis);

void device_lock(const struct device *device);
void device_unlock(const struct device *device);

#endif
