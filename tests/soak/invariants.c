#include "invariants.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#define CHECK(condition) ((condition) ? (void)0 : fail(device, #condition, __LINE__))

_Noreturn static void fail(const struct device *device, const char *what, int line)
{
    fprintf(stderr, "invariants.c:%d: %s (tick %" PRIu64 ", state %u, fault %u)\n", line, what, device->control.tick,
            (unsigned)device->control.state, (unsigned)device->control.fault);
    abort();
}

static void remember(struct invariants *seen, const struct device *device)
{
    seen->tick = device->control.tick;
    seen->state = device->control.state;
    seen->fault = device->control.fault;
    for (unsigned axis = 0; axis < AXES; axis++) {
        seen->u_q24[axis] = device->control.axis[axis].u_q24;
        seen->dac_codes[axis] = device->dac_codes[axis];
    }
}

static bool at_home(const struct device *device)
{
    for (unsigned axis = 0; axis < AXES; axis++)
        if (device->control.axis[axis].u_q24 != device->control.config[axis].u_park_q24)
            return false;
    return true;
}

/* docs/faults.md: these two leave the outputs where they are. */
static bool holds(uint32_t fault)
{
    return fault == WIRE_FAULT_FLASH_ERROR || fault == WIRE_FAULT_TRACKING_ERROR;
}

/* One tick nearer to the safe value: by the ramp or, where a hard limit made it less, by the slew limit. */
static int32_t ramped_q24(const struct axis_config *config, int32_t from_q24)
{
    const int32_t slew_q24 = config->output.slew_q24, ramp_q24 = config->ramp_q24;
    const int64_t step_q24 = ramp_q24 < slew_q24 ? ramp_q24 : slew_q24;
    int64_t way_q24 = (int64_t)config->u_park_q24 - from_q24;
    if (way_q24 > step_q24)
        way_q24 = step_q24;
    if (way_q24 < -step_q24)
        way_q24 = -step_q24;
    return (int32_t)(from_q24 + way_q24);
}

static void check_names(const struct device *device)
{
    const struct control *now = &device->control;
    CHECK(now->state < WIRE_STATE_COUNT && now->fault < WIRE_FAULT_COUNT);
    CHECK((now->fault != WIRE_FAULT_NONE) == (now->state == WIRE_STATE_FAULT));
    for (unsigned axis = 0; axis < AXES; axis++) {
        CHECK(now->config[axis].mode < WIRE_MODE_COUNT);
        CHECK(now->config[axis].path.kind < WIRE_PATH_KIND_COUNT);
        CHECK(now->axis[axis].drive <= DRIVE_RAMP);
        CHECK(now->queue[axis].count <= SEGMENTS_QUEUED);
    }
}

/* Limits of the configuration, in volts, and the hard ones, in codes. */
static void check_limits(const struct invariants *seen, const struct device *device, unsigned axis)
{
    const struct output_config *output = &device->control.config[axis].output;
    const struct wire_axis_limits *hard = &device->journal.newest.limits[axis];
    const int32_t u_q24 = device->control.axis[axis].u_q24;
    const int64_t step_q24 = (int64_t)u_q24 - seen->u_q24[axis];
    const int64_t code = device->dac_codes[axis], code_step = code - seen->dac_codes[axis];
    const int64_t most_codes = ((int64_t)hard->slew_codes_q16 >> 16) + 2; /* two ends are rounded */
    CHECK(u_q24 >= output->u_min_q24 && u_q24 <= output->u_max_q24);
    CHECK(step_q24 <= output->slew_q24 && step_q24 >= -(int64_t)output->slew_q24);
    CHECK(u_q24 == 0 || (code >= hard->dac_min && code <= hard->dac_max));
    CHECK(code_step <= most_codes && code_step >= -most_codes);
    CHECK(seen->was_armed || u_q24 == 0);
}

/* Where an output that follows no path is. */
static void check_rest(const struct invariants *seen, const struct device *device, unsigned axis)
{
    const struct control *now = &device->control;
    const int32_t u_q24 = now->axis[axis].u_q24, before_q24 = seen->u_q24[axis];
    const int32_t home_q24 = ramped_q24(&now->config[axis], before_q24);
    switch (seen->state) {
    case WIRE_STATE_PARKED:
        CHECK(u_q24 == before_q24 || (u_q24 == home_q24 && seen->goes_to_zero));
        CHECK(u_q24 != before_q24 || device->dac_codes[axis] == seen->dac_codes[axis]);
        break;
    case WIRE_STATE_STOPPING:
        CHECK(u_q24 == home_q24);
        break;
    case WIRE_STATE_FAULT:
        CHECK(u_q24 == home_q24 || (u_q24 == before_q24 && !seen->on_way_home));
        break;
    default:
        break;
    }
}

/* A tick begins no path, ends a way home, and may meet a fault; it forgets none. */
static void check_transition_of_tick(const struct invariants *seen, const struct device *device)
{
    const struct control *now = &device->control;
    const bool arrived = seen->state == WIRE_STATE_STOPPING && now->state == WIRE_STATE_PARKED;
    CHECK(now->state == seen->state || now->state == WIRE_STATE_FAULT || arrived);
    CHECK(seen->fault == WIRE_FAULT_NONE || now->fault == seen->fault);
    CHECK(now->state != WIRE_STATE_STOPPING || !at_home(device));
    CHECK(now->state != WIRE_STATE_PARKED || at_home(device) || seen->goes_to_zero);
}

static void check_host_is_heard(const struct device *device)
{
    const struct control *now = &device->control;
    if ((now->state == WIRE_STATE_ARMED || now->state == WIRE_STATE_RUNNING) && now->timeout_ticks != 0)
        CHECK(now->tick - 1 - now->heard_tick < now->timeout_ticks);
}

/* A fault that ramps sends every output home from the next tick on at the latest; one that holds, when it is overruled.
 */
static void note_way_home(struct invariants *seen, const struct device *device)
{
    const struct control *now = &device->control;
    if (now->state != WIRE_STATE_FAULT) {
        seen->on_way_home = false;
        return;
    }
    if (seen->state != WIRE_STATE_FAULT) {
        seen->faults++;
        seen->fault_ticks = 0;
        seen->on_way_home = !holds(now->fault) || seen->state == WIRE_STATE_STOPPING;
    } else if (!at_home(device)) {
        seen->fault_ticks++;
        if (seen->on_way_home && seen->fault_ticks > seen->longest_way_home)
            seen->longest_way_home = seen->fault_ticks;
    }
    for (unsigned axis = 0; axis < AXES && seen->state == WIRE_STATE_FAULT; axis++)
        if (now->axis[axis].u_q24 != seen->u_q24[axis])
            seen->on_way_home = true;
}

void invariants_reset(struct invariants *seen, const struct device *device)
{
    remember(seen, device);
    seen->was_armed = seen->goes_to_zero = false;
    seen->on_way_home = device->control.state == WIRE_STATE_FAULT;
    check_names(device);
    for (unsigned axis = 0; axis < AXES; axis++)
        CHECK(device->control.axis[axis].u_q24 == 0);
}

/* A tick that plays points that come meanwhile, or leaves them, lies between two that have come and are not yet
 * overwritten. Before its wait is over a path counts for nothing. */
static void check_points(const struct device *device, unsigned axis)
{
    const struct control *now = &device->control;
    const struct points_ring *ring = &now->points[axis];
    const struct join_state *join = &now->axis[axis].join;
    if (ring->ring != POINTS_PLAYED || now->axis[axis].drive != DRIVE_PATH)
        return;
    const bool joins = join->step_turn64 != 0;
    const bool leaves = joins && join->standing == 0 && join->path.kind == PATH_WAVE;
    const bool enters = joins && now->config[axis].path.kind == PATH_WAVE;
    const bool plays = now->config[axis].path.kind == PATH_WAVE && now->axis[axis].path.running != 0;
    if (!leaves && (!plays || (enters && join->wait_ticks != 0)))
        return;
    const uint64_t phase_turn64 = leaves ? join->state.phase_turn64 : now->axis[axis].path.phase_turn64;
    const uint32_t place = (uint32_t)(phase_turn64 >> 54), next = (uint32_t)ring->next % WAVE_POINTS;
    const uint32_t ahead = (next - place) % WAVE_POINTS; /* points that have come, from the one before now on */
    CHECK(ring->next - ring->first < WAVE_POINTS || ahead != 1);
    CHECK(ring->next - ring->first >= WAVE_POINTS || ahead <= (uint32_t)(ring->next - ring->first));
    CHECK(ahead != 1 || now->config[axis].leave_ticks == 0);
}

void invariants_after_tick(struct invariants *seen, const struct device *device)
{
    check_names(device);
    CHECK(device->control.tick == seen->tick + 1);
    check_transition_of_tick(seen, device);
    check_host_is_heard(device);
    for (unsigned axis = 0; axis < AXES; axis++) {
        check_limits(seen, device, axis);
        check_points(device, axis);
        check_rest(seen, device, axis);
    }
    note_way_home(seen, device);
    remember(seen, device);
}

void invariants_after_command(struct invariants *seen, const struct device *device, uint8_t type)
{
    const struct control *now = &device->control;
    const uint32_t from = seen->state, to = now->state;
    check_names(device);
    CHECK(now->tick == seen->tick);
    for (unsigned axis = 0; axis < AXES; axis++)
        CHECK(now->axis[axis].u_q24 == seen->u_q24[axis] && device->dac_codes[axis] == seen->dac_codes[axis]);
    if (from != to) {
        const bool stops = type == WIRE_PARK || type == WIRE_STOP || type == WIRE_HELLO;
        const bool drove = from == WIRE_STATE_ARMED || from == WIRE_STATE_RUNNING;
        CHECK((from == WIRE_STATE_PARKED && to == WIRE_STATE_ARMED && type == WIRE_ARM) ||
              (from == WIRE_STATE_ARMED && to == WIRE_STATE_RUNNING && type == WIRE_START) ||
              (drove && to == WIRE_STATE_STOPPING && stops) ||
              (from == WIRE_STATE_FAULT && to == WIRE_STATE_PARKED && type == WIRE_CLEAR_FAULT && at_home(device)) ||
              (from == WIRE_STATE_PARKED && to == WIRE_STATE_FAULT && now->fault == WIRE_FAULT_FLASH_ERROR));
    }
    CHECK(now->fault == seen->fault || type == WIRE_CLEAR_FAULT || from == WIRE_STATE_PARKED);
    if (from != to)
        note_way_home(seen, device);
    if (to == WIRE_STATE_PARKED && (type == WIRE_UPDATE_BEGIN || type == WIRE_UPDATE_RESTART))
        seen->goes_to_zero = true;
    seen->goes_to_zero = seen->goes_to_zero && to == WIRE_STATE_PARKED;
    CHECK(to != WIRE_STATE_PARKED || at_home(device) || seen->goes_to_zero);
    if (from == WIRE_STATE_FAULT && (type == WIRE_PARK || type == WIRE_STOP))
        seen->on_way_home = true;
    seen->was_armed = seen->was_armed || to == WIRE_STATE_ARMED;
    remember(seen, device);
}
