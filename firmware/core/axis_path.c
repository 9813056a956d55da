#include "core/axis_path.h"

#include "core/fixed.h"

#define ONE_Q16 65536u

static uint32_t preview_ticks_q16(const struct axis_model *model)
{
    return model->compensation != NULL ? model->compensation->preview_ticks_q16 : 0;
}

/* The paths and what tells them apart: the one that is followed, and the one that is being left. */
struct course {
    const struct path_config *path;
    const struct feedforward_point *point;
    const struct path_state *state;
};

static int32_t look_ahead_q16(const struct course *course, const struct axis_model *model, bool *saturated)
{
    return path_ahead(course->path, course->state, model->wave_q30, course->point->lead_turn32,
                      preview_ticks_q16(model), saturated);
}

/* A periodic path is divided by the gain, one phase lead ahead. A hold or a move is slow, so it needs no lead. */
static int32_t table_feedforward_q24(const struct course *course, const struct axis_model *model, int32_t reference,
                                     bool *saturated)
{
    if (!path_is_periodic(course->path))
        return model->tables != NULL ? feedforward_static_q24(model->tables, reference) : 0;
    return feedforward_step_q24(course->point, look_ahead_q16(course, model, saturated), saturated);
}

static struct axis_wanted wanted_of(const struct course *course, const struct axis_model *model, uint32_t mode,
                                    bool follows, bool *saturated)
{
    struct axis_wanted wanted = {.reference = path_now(course->path, course->state, model->wave_q30, saturated)};
    if (!follows)
        return wanted;
    if (mode == AXIS_OPEN)
        wanted.feedforward_q24 = wanted.reference; /* the path is volts */
    else if (axis_mode_uses_tables(mode))
        wanted.feedforward_q24 = table_feedforward_q24(course, model, wanted.reference, saturated);
    else if (axis_mode_inverts(mode))
        wanted.ahead_q16 = look_ahead_q16(course, model, saturated);
    return wanted;
}

static struct axis_wanted wanted_before(const struct axis_config *config, const struct axis_model *model,
                                        const struct axis_state *state, bool follows, bool *saturated)
{
    const struct join_state *join = &state->join;
    const bool gives_volts = config->mode == AXIS_OPEN || axis_mode_uses_tables(config->mode);
    if (join->standing != 0)
        return (struct axis_wanted){join->path.offset, join->ahead_q16, gives_volts ? join->u_q24 : 0};
    const struct course course = {&join->path, &join->point, &join->state};
    return wanted_of(&course, model, config->mode, follows, saturated);
}

/* Not so in the tick that begins a join, which has enough to do. */
static bool new_path_counts(const struct axis_config *config, const struct axis_model *model,
                            const struct join_state *join)
{
    const uint32_t ahead_q16 = axis_mode_inverts(config->mode) ? preview_ticks_q16(model) : 0;
    return join->phase_turn64 != 0 || (uint64_t)join->wait_ticks << 16 < ahead_q16;
}

struct axis_wanted axis_wanted(const struct axis_config *config, const struct axis_model *model,
                               const struct axis_state *state, bool follows, bool *saturated)
{
    const struct join_state *join = &state->join;
    if (join_is_under_way(join) && !new_path_counts(config, model, join))
        return wanted_before(config, model, state, follows, saturated);
    const struct course course = {&config->path, &config->point, &state->path};
    const struct axis_wanted now = wanted_of(&course, model, config->mode, follows, saturated);
    if (!join_is_under_way(join))
        return now;
    const struct axis_wanted before = wanted_before(config, model, state, follows, saturated);
    const uint32_t weight_q30 = path_least_jerk_q30(join->phase_turn64);
    struct axis_wanted mixed = {.reference = lerp_i32(before.reference, now.reference, weight_q30)};
    if (axis_mode_inverts(config->mode))
        mixed.ahead_q16 = lerp_i32(before.ahead_q16, now.ahead_q16, join_weight_q30(join, preview_ticks_q16(model)));
    else
        mixed.feedforward_q24 = lerp_i32(before.feedforward_q24, now.feedforward_q24, weight_q30);
    return mixed;
}

bool axis_path_advance(const struct axis_config *config, struct axis_state *state)
{
    const bool joins = join_is_under_way(&state->join);
    if (joins)
        join_advance(&state->join);
    if (!joins || config->path.kind == PATH_MOVE || state->path.wait_ticks != 0)
        return path_advance(&config->path, &state->path);
    path_run_on(&config->path, &state->path); /* its length counts from the end of the join */
    return false;
}

/* A look ahead begins before the path does, so the path waits for so long. */
uint32_t axis_wait_ticks(const struct axis_config *config, const struct axis_model *model)
{
    return axis_mode_inverts(config->mode) ? (preview_ticks_q16(model) + ONE_Q16 - 1) >> 16 : 0;
}

static bool enters(const struct axis_config *config)
{
    return config->enter_ticks != 0 || (config->path.flags & PATH_FROM_HERE) != 0;
}

uint32_t axis_enter_ticks(const struct axis_config *config, const struct axis_model *model)
{
    return enters(config) ? config->enter_ticks + axis_wait_ticks(config, model) : 0;
}

static void begin_at(struct axis_config *config, int32_t here)
{
    bool saturated = false;
    struct path_config *path = &config->path;
    if ((path->flags & PATH_FROM_HERE) == 0)
        return;
    path->flags &= ~(uint32_t)PATH_FROM_HERE;
    path->offset = here;
    if (path->kind == PATH_MOVE)
        path->swing = sat_sub_i32(path->swing, here, &saturated);
}

static void begin_join(const struct axis_config *config, struct axis_state *state, uint32_t wait_ticks)
{
    state->join.phase_turn64 = 0;
    state->join.step_turn64 = config->enter_ticks != 0 ? config->enter_turn64 : 0;
    state->join.wait_ticks = wait_ticks;
    path_start(&state->path);
    if (path_is_periodic(&config->path))
        state->path.phase_turn64 -= config->path.step_turn64 * (config->enter_ticks + wait_ticks);
    else
        state->path.wait_ticks = wait_ticks;
}

void axis_enter(struct axis_config *config, const struct axis_model *model, struct axis_state *state, uint16_t adc_code,
                uint32_t enter_ticks)
{
    bool saturated = false;
    const bool volts = config->mode == AXIS_OPEN;
    state->join.ahead_q16 = compensation_here_q16(model->compensation, &state->compensation);
    if (!enters(config))
        return;
    const int32_t here = volts ? state->u_q24 : converter_position_q16(&config->converter, adc_code, &saturated);
    state->join.path.kind = PATH_HOLD; /* nothing else of a hold is looked at */
    state->join.path.offset = here;
    state->join.u_q24 = state->u_q24;
    state->join.standing = 1;
    state->target.reference = here;
    begin_at(config, here);
    begin_join(config, state, enter_ticks - config->enter_ticks);
    if (!path_is_periodic(&config->path))
        state->path.wait_ticks += config->enter_ticks;
}

/* Where the path that is being left will be then, for one that begins there. */
static int32_t here_in(const struct join_state *join, const struct axis_model *model, uint32_t ticks, uint32_t flags)
{
    bool saturated = false;
    if ((flags & PATH_FROM_HERE) == 0)
        return 0;
    return path_ahead(&join->path, &join->state, model->wave_q30,
                      (int32_t)(uint32_t)(join->path.step_turn64 * ticks >> 32), ticks << 16, &saturated);
}

void axis_begin(struct axis_config *config, const struct axis_model *model, struct axis_state *state,
                const struct segment *segment, uint32_t wait_ticks)
{
    struct join_state *join = &state->join;
    join->path = config->path;
    join->point = config->point;
    join->state = state->path;
    join->ahead_q16 = join->u_q24 = 0;
    join->standing = 0;
    if (path_is_periodic(&join->path))
        join->state.running = 1; /* it has ended, or is left before its end: either way it runs on */
    const int32_t here = here_in(join, model, wait_ticks + segment->enter_ticks / 2, segment->path.flags);
    config->path = segment->path;
    config->point = segment->point;
    config->enter_turn64 = segment->enter_turn64;
    config->leave_turn64 = segment->leave_turn64;
    config->enter_ticks = segment->enter_ticks;
    config->leave_ticks = segment->leave_ticks;
    begin_at(config, here);
    begin_join(config, state, wait_ticks);
    state->near_ticks = 0;
}

bool axis_path_is_over(const struct axis_config *config, const struct axis_state *state)
{
    return state->path.running == 0 || (config->path.ticks == 0 && config->path.kind != PATH_MOVE);
}

bool axis_leave(struct axis_config *config, const struct axis_model *model, struct axis_state *state)
{
    if (state->path.running != 0 || config->leave_ticks == 0 || !path_is_periodic(&config->path))
        return false;
    const struct segment hold = {.path = {.kind = PATH_HOLD, .flags = PATH_FROM_HERE},
                                 .enter_turn64 = config->leave_turn64,
                                 .enter_ticks = config->leave_ticks};
    axis_begin(config, model, state, &hold, axis_wait_ticks(config, model));
    state->path.running = state->path.wait_ticks = 0; /* it stands: what is queued behind it waits for the join alone */
    return true;
}
