#include "app/device.h"

#include <string.h>

#include "app/service.h"
#include "core/fixed.h"

#define ALL_AXES ((1u << AXES) - 1)
/* With a constant axis: to pass over one is a test of a bit. */
#define EACH_AXIS inline __attribute__((always_inline))

_Static_assert(AXES == 3, "a tick names its axes one by one");

/* Without a model: -2..10 V, 1000 V/s, parking at 50 V/s on 0 V; 16-bit converters over +-10.24 V and -10..270 um. */
static const struct wire_axis_model DEFAULT_AXIS = {
    .u_min_q24 = -(2 << 24),
    .u_max_q24 = 10 << 24,
    .u_park_q24 = 0,
    .slew_q24 = 3355443, /* 0.2 V a tick */
    .ramp_q24 = 167772,  /* 0.01 V a tick */
    .dac_zero_code = 32768,
    .dac_codes_per_V_q16 = 209715200, /* 65536 / 20.48 V */
    .adc_zero_code = 2341,            /* 10 um x 65536 / 280 um = 2340.57 */
    .adc_um_per_code_q32 = 18350080,  /* 280 um / 65536 */
};

void device_lock(const struct device *device)
{
    if (device->port.lock)
        device->port.lock(device->port.context);
}

void device_unlock(const struct device *device)
{
    if (device->port.unlock)
        device->port.unlock(device->port.context);
}

const struct feedforward_tables *device_tables(const struct device *device, unsigned axis)
{
    const struct model_slot *slot = model_store_active(&device->models);
    return slot && slot->table_mask >> axis & 1u ? &slot->tables[axis] : NULL;
}

const struct compensation *device_compensation(const struct device *device, unsigned axis)
{
    const struct model_slot *slot = model_store_active(&device->models);
    return slot && slot->inverse_mask >> axis & 1u ? &slot->compensation[axis] : NULL;
}

const int32_t *device_wave_q30(const struct device *device, unsigned axis)
{
    return device->wave_mask >> axis & 1u ? device->waves_q30[axis] : NULL;
}

void device_stir(struct device *device, unsigned axis)
{
    device->still &= ~(1u << axis);
}

void device_link_models(struct device *device)
{
    device->still = 0;
    for (unsigned axis = 0; axis < AXES; axis++)
        device->model_of[axis] = (struct axis_model){device_tables(device, axis), device_compensation(device, axis),
                                                     device_wave_q30(device, axis)};
}

static void reset_axis(struct device *device, unsigned axis)
{
    const struct model_slot *slot = model_store_active(&device->models);
    struct axis_config *config = &device->control.config[axis];
    struct axis_state *state = &device->control.axis[axis];
    const struct wire_axis_model *model = slot ? model_axis(slot, axis, &device->models.room) : &DEFAULT_AXIS;
    memset(config, 0, sizeof *config);
    config->u_park_q24 = model->u_park_q24;
    config->ramp_q24 = model->ramp_q24;
    config->pid.d_alpha_q31 = PID_DERIVATIVE_UNFILTERED;
    config->output.u_min_q24 = model->u_min_q24;
    config->output.u_max_q24 = model->u_max_q24;
    config->output.slew_q24 = model->slew_q24;
    config->converter.dac_zero_code = model->dac_zero_code;
    config->converter.dac_codes_per_V_q16 = model->dac_codes_per_V_q16;
    config->converter.adc_zero_code = model->adc_zero_code;
    config->converter.adc_um_per_code_q32 = model->adc_um_per_code_q32;
    memset(&state->path, 0, sizeof state->path);
    memset(&state->target, 0, sizeof state->target);
    pid_reset(&state->pid);
}

void device_reset_axes(struct device *device)
{
    device->control.path_mask = 0;
    device->still = 0;
    for (unsigned axis = 0; axis < AXES; axis++)
        reset_axis(device, axis);
}

void device_rest(struct device *device)
{
    for (unsigned axis = 0; axis < AXES; axis++) {
        struct axis_state *state = &device->control.axis[axis];
        const struct compensation *compensation = device_compensation(device, axis);
        if (compensation)
            compensation_rest(compensation, &state->compensation, state->u_q24);
        else
            memset(&state->compensation, 0, sizeof state->compensation);
    }
}

void device_init(struct device *device, const struct device_port *port)
{
    memset(device, 0, sizeof *device);
    device->port = *port;
    device->control.timeout_ticks = HOST_TIMEOUT_TICKS;
    device->control.fault_axis = NO_AXIS;
    model_store_boot(&device->models, &device->port.flash);
    device_link_models(device);
    device_reset_axes(device);
    device_rest(device);
    service_init(device);
    for (unsigned axis = 0; axis < AXES; axis++) {
        bool saturated = false;
        device->control.axis[axis].drive = DRIVE_RAMP; /* the hardware starts at 0 V; a model may park elsewhere */
        device->dac_codes[axis] = converter_dac_code(&device->control.config[axis].converter, 0, &saturated);
    }
    if (port->reset_cause == WIRE_RESET_CAUSE_WATCHDOG)
        device_fault(device, WIRE_FAULT_CORE_LOST, NO_AXIS, 0);
}

uint8_t device_at_rest_mask(const struct device *device)
{
    unsigned mask = 0;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (device->control.axis[axis].u_q24 == device->control.config[axis].u_park_q24)
            mask |= 1u << axis;
    return (uint8_t)mask;
}

/* What the others cause in an axis of `mask` is taken from its value. */
static __attribute__((noinline)) void decoupled(struct device *device, uint32_t mask, int32_t values_q16[AXES])
{
    const struct model_slot *slot = model_store_active(&device->models);
    bool saturated = false;
    decouple(slot != NULL ? &slot->decoupling : NULL, mask, values_q16, &saturated);
    for (unsigned axis = 0; axis < AXES && saturated; axis++)
        if ((mask >> axis & 1u) != 0)
            device->control.axis[axis].target.flags |= TARGET_SATURATED;
}

/* The inverse's voltages for where the axes of `feeding` should be, next to others that invert. */
static __attribute__((noinline)) void feed_axes(struct device *device, uint32_t feeding)
{
    int32_t ahead_q16[AXES];
    uint32_t inverting = 0;
    for (unsigned axis = 0; axis < AXES; axis++) {
        const struct axis_state *state = &device->control.axis[axis];
        ahead_q16[axis] = state->target.ahead_q16;
        if (state->drive == DRIVE_PATH && (state->target.flags & TARGET_INVERSE) != 0)
            inverting |= 1u << axis;
    }
    decoupled(device, inverting, ahead_q16);
    for (unsigned axis = 0; axis < AXES; axis++)
        if ((feeding >> axis & 1u) != 0)
            axis_invert(&device->model_of[axis], &device->control.axis[axis], ahead_q16[axis]);
}

/* Bit of the axis when its inverse is to be fed. */
static EACH_AXIS uint32_t aim_one(struct device *device, unsigned axis)
{
    struct axis_state *state = &device->control.axis[axis];
    if ((device->still >> axis & 1u) != 0 || !axis_needs_target(state))
        return 0;
    return (uint32_t)axis_set_target(&device->control.config[axis], &device->model_of[axis], state) << axis;
}

/* Where the axes that follow a path should be next, and the feed-forward for it: at their start, and behind the output
 * of every tick for the one to come. */
static EACH_AXIS void aim_axes(struct device *device)
{
    uint32_t feeding = aim_one(device, 0);
    if ((~device->still & ALL_AXES & ~1u) != 0)
        feeding |= aim_one(device, 1) | aim_one(device, 2);
    if (feeding != 0)
        feed_axes(device, feeding);
}

static void drive_all(struct device *device, enum axis_drive drive)
{
    struct control *control = &device->control;
    device->still = 0;
    for (unsigned axis = 0; axis < AXES; axis++) {
        control->axis[axis].drive = drive;
        control->axis[axis].path.running = 0;
    }
}

static __attribute__((noinline)) void start_axes(struct device *device, uint8_t axis_mask)
{
    struct control *control = &device->control;
    device->still &= ~(uint32_t)axis_mask;
    for (unsigned axis = 0; axis < AXES; axis++)
        if (axis_mask >> axis & 1u)
            axis_start(&control->axis[axis]);
    aim_axes(device);
}

enum wire_status device_event(struct device *device, enum supervisor_event event, uint8_t axis_mask)
{
    struct control *control = &device->control;
    struct supervisor_step step = supervisor_step((enum wire_state)control->state, event);
    switch ((enum supervisor_action)step.action) {
    case ACTION_REFUSE:
        return WIRE_STATUS_WRONG_STATE;
    case ACTION_REFUSE_FAULT:
        return WIRE_STATUS_FAULT_LATCHED;
    case ACTION_START:
        start_axes(device, axis_mask);
        break;
    case ACTION_HOLD:
        drive_all(device, DRIVE_HOLD);
        break;
    case ACTION_RAMP:
        drive_all(device, DRIVE_RAMP);
        break;
    case ACTION_NONE:
    case ACTION_COUNT:
        break;
    }
    if (step.state != control->state) {
        control->state = step.state;
        events_put(&device->events, control->tick, WIRE_EVENT_KIND_STATE_CHANGE, step.state);
    }
    return WIRE_STATUS_OK;
}

void device_fault(struct device *device, enum wire_fault fault, unsigned axis, uint32_t detail)
{
    struct control *control = &device->control;
    if (control->fault == WIRE_FAULT_NONE) { /* the first one stays: the rest may be its consequences */
        control->fault = fault;
        control->fault_axis = axis;
        control->fault_detail = detail;
        control->fault_tick = control->tick;
        device->last_fault = fault;
        device->last_fault_detail = detail;
        events_put(&device->events, control->tick, WIRE_EVENT_KIND_FAULT, fault);
        recorder_freeze(&device->recorder);
    }
    device_event(device, (enum supervisor_event)FAULT_REACTIONS[fault].event, 0);
}

void device_raise(struct device *device, enum wire_fault fault, unsigned axis, uint32_t detail)
{
    uint32_t none = WIRE_FAULT_NONE;
    device->raised_as[fault].axis = axis;
    device->raised_as[fault].detail = detail;
    atomic_compare_exchange_strong_explicit(&device->raised_first, &none, fault, memory_order_relaxed,
                                            memory_order_relaxed);
    atomic_fetch_or_explicit(&device->raised, 1u << fault, memory_order_release);
}

static void take_fault(struct device *device, uint32_t raised, unsigned fault)
{
    if ((raised >> fault & 1u) != 0)
        device_fault(device, (enum wire_fault)fault, device->raised_as[fault].axis, device->raised_as[fault].detail);
}

/* The first to be raised is the one that is latched. */
static __attribute__((noinline)) void take_raised(struct device *device)
{
    uint32_t raised = atomic_exchange_explicit(&device->raised, 0, memory_order_acquire);
    uint32_t first = atomic_exchange_explicit(&device->raised_first, WIRE_FAULT_NONE, memory_order_relaxed);
    take_fault(device, raised, first);
    for (unsigned fault = 1; fault < WIRE_FAULT_COUNT; fault++)
        if (fault != first)
            take_fault(device, raised, fault);
}

static void watch_host(struct device *device)
{
    const struct control *control = &device->control;
    bool driving = control->state == WIRE_STATE_ARMED || control->state == WIRE_STATE_RUNNING;
    if (driving && control->timeout_ticks != 0 && control->tick - control->heard_tick >= control->timeout_ticks)
        device_fault(device, WIRE_FAULT_HOST_TIMEOUT, NO_AXIS, 0);
}

/* A loop that can no longer see where it is must not go on pushing. */
static __attribute__((noinline)) void watch_rail(struct device *device, unsigned axis)
{
    const struct control *control = &device->control;
    if (axis_mode_has_feedback(control->config[axis].mode) && control->axis[axis].drive == DRIVE_PATH)
        device_fault(device, WIRE_FAULT_ADC_RAIL, axis, device->adc_codes[axis]);
}

/* Bit of the axis when it is under feedback. */
static EACH_AXIS uint32_t find_error(struct device *device, unsigned axis, uint32_t moving, int32_t *error_q16)
{
    struct axis_state *state = &device->control.axis[axis];
    if ((moving >> axis & 1u) == 0 || !axis_has_feedback(state))
        return 0;
    *error_q16 = axis_error_q16(&device->control.config[axis], state, device->adc_codes[axis]);
    return 1u << axis;
}

static EACH_AXIS void step_one(struct device *device, unsigned axis, uint32_t moving, int32_t error_q16)
{
    struct axis_trace *trace = &device->traces[axis];
    if ((moving >> axis & 1u) == 0)
        return;
    bool rests = axis_step(&device->control.config[axis], &device->control.axis[axis], device->adc_codes[axis],
                           error_q16, trace);
    device->still |= (uint32_t)rests << axis;
    device->dac_codes[axis] = trace->dac_code;
}

static EACH_AXIS void settle_one(struct device *device, unsigned axis, uint32_t moving)
{
    struct axis_state *state = &device->control.axis[axis];
    if ((moving >> axis & 1u) == 0)
        return;
    if (axis_follow_output(&device->model_of[axis], state, &device->traces[axis]))
        device_stir(device, axis);
    if (state->rail_ticks >= RAIL_TICKS && device->control.state == WIRE_STATE_RUNNING)
        watch_rail(device, axis);
    if (device->traces[axis].path_done) {
        device->rare = true;
        device->path_done_tick[axis] = device->control.tick;
        uint32_t done = atomic_load_explicit(&device->path_done, memory_order_relaxed); /* no tick interrupts another */
        atomic_store_explicit(&device->path_done, done | 1u << axis, memory_order_relaxed);
    }
}

void device_tick(struct device *device, const uint16_t adc_codes[AXES], uint16_t dac_codes[AXES])
{
    struct control *control = &device->control;
    int32_t x_q16 = 0, y_q16 = 0, z_q16 = 0; /* errors */
    if (atomic_load_explicit(&device->raised, memory_order_relaxed) != 0)
        take_raised(device);
    watch_host(device);
    memcpy(device->adc_codes, adc_codes, sizeof device->adc_codes);
    const uint32_t moving = ~device->still & ALL_AXES;
    const bool others = (moving & ~1u) != 0; /* where the first moves alone, they are passed over together */
    uint32_t closed = find_error(device, 0, moving, &x_q16);
    if (others) {
        closed |= find_error(device, 1, moving, &y_q16) | find_error(device, 2, moving, &z_q16);
        if ((closed & (closed - 1)) != 0) {
            int32_t error_q16[AXES] = {x_q16, y_q16,
                                       z_q16}; /* here alone, so that one axis has its own in a register */
            decoupled(device, closed, error_q16);
            x_q16 = error_q16[0], y_q16 = error_q16[1], z_q16 = error_q16[2];
        }
    }
    step_one(device, 0, moving, x_q16);
    if (others) {
        step_one(device, 1, moving, y_q16);
        step_one(device, 2, moving, z_q16);
    }
    if (device->port.drive)
        device->port.drive(device->port.context, device->dac_codes);
    else
        memcpy(dac_codes, device->dac_codes, sizeof device->dac_codes);
    settle_one(device, 0, moving);
    if (others) {
        settle_one(device, 1, moving);
        settle_one(device, 2, moving);
    }
    if (control->state == WIRE_STATE_STOPPING && device_at_rest_mask(device) == ALL_AXES)
        device_event(device, EVENT_AT_REST, 0);
    enum recorder_took took = recorder_tick(&device->recorder, control->tick, device->adc_codes, device->traces);
    if (took != RECORDER_TOOK)
        device->rare = true;
    if (took == RECORDER_DROPS)
        events_put(&device->events, control->tick, WIRE_EVENT_KIND_STREAM_OVERFLOW, (uint32_t)device->recorder.dropped);
    control->tick++;
    aim_axes(device);
}

void device_tell(struct device *device)
{
    if (atomic_load_explicit(&device->path_done, memory_order_relaxed) == 0)
        return;
    device_lock(device);
    uint32_t done = atomic_exchange_explicit(&device->path_done, 0, memory_order_relaxed);
    for (unsigned axis = 0; axis < AXES; axis++)
        if (done >> axis & 1u)
            events_put(&device->events, device->path_done_tick[axis], WIRE_EVENT_KIND_PATH_DONE, axis);
    device_unlock(device);
}

void device_miss_ticks(struct device *device, uint32_t ticks)
{
    device->control.tick += ticks;
    recorder_miss(&device->recorder, ticks);
}
