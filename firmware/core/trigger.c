#include "core/trigger.h"

#include "core/fixed.h"

#define PULSED UINT32_MAX
#define NO_PLACE INT32_MIN

void trigger_set(struct trigger *trigger, const struct trigger_config *config, const struct axis_state *axis)
{
    *trigger = (struct trigger){.config = *config, .state.reference = axis->target.reference};
    if (config->mark == TRIGGER_WAY)
        trigger->state.mark = (uint32_t)NO_PLACE;
    else if (config->mark == TRIGGER_TARGET)
        trigger->state.mark = PULSED;
}

/* Whether the tick to come is one of the path itself, for the path has been advanced to the one after. */
static bool is_on_path(const struct axis_config *config, const struct axis_state *axis)
{
    const bool runs = axis->path.running != 0 || (axis->target.flags & TARGET_PATH_DONE) != 0;
    return runs && (axis->target.flags & TARGET_FOLLOWS_PATH) != 0 && axis->path.elapsed != 0 &&
           config->path.kind != PATH_HOLD;
}

/* Half a tick later than the phase is, so that each mark is in the tick next to it. */
static bool turn_step(struct trigger *trigger, const struct path_config *path, const struct path_state *state)
{
    const uint32_t phase_turn32 = (uint32_t)((state->phase_turn64 - path->step_turn64 / 2) >> 32);
    const uint32_t before_q32 = trigger->state.mark;
    trigger->state.mark = phase_turn32 * trigger->config.every; /* whole marks wrap */
    return state->elapsed == 1 || trigger->state.mark < before_q32;
}

static bool time_step(struct trigger *trigger, const struct path_state *state)
{
    if (state->elapsed != 1) {
        if (trigger->state.mark == 0)
            return false;
        trigger->state.mark--;
        if (trigger->state.mark != 0)
            return false;
    }
    trigger->state.mark = trigger->config.every;
    return true;
}

static bool way_step(struct trigger *trigger, int32_t reference)
{
    const int64_t way = (int64_t)reference - trigger->config.origin;
    const int32_t before = (int32_t)trigger->state.mark;
    const int32_t place = (int32_t)floor_shift_i64(way * trigger->config.every, 32);
    trigger->state.mark = (uint32_t)place;
    if (before == NO_PLACE)
        return false;
    return trigger->config.rising != 0 ? place > before : place != before;
}

static bool target_step(struct trigger *trigger, const struct axis_config *config, const struct axis_state *axis)
{
    struct trigger_state *state = &trigger->state;
    if (axis->target.reference != state->reference) {
        state->reference = axis->target.reference;
        state->mark = 0;
        return false;
    }
    if (state->mark == PULSED || config->mode == AXIS_OPEN)
        return false;
    state->mark++;
    if (axis->near_ticks == 0 || axis->near_ticks < config->window_ticks || state->mark < config->window_ticks)
        return false;
    state->mark = PULSED;
    return true;
}

bool trigger_step(struct trigger *trigger, const struct axis_config *config, const struct axis_state *axis)
{
    const uint32_t mark = trigger->config.mark;
    if (mark == TRIGGER_NONE)
        return false;
    if (mark == TRIGGER_TARGET)
        return axis->drive == DRIVE_PATH && target_step(trigger, config, axis);
    if (!is_on_path(config, axis)) {
        trigger->state.mark = mark == TRIGGER_WAY ? (uint32_t)NO_PLACE : 0;
        return false;
    }
    if (mark == TRIGGER_WAY)
        return way_step(trigger, axis->target.reference);
    if (mark == TRIGGER_TIME)
        return time_step(trigger, &axis->path);
    return path_is_periodic(&config->path) && turn_step(trigger, &config->path, &axis->path);
}
