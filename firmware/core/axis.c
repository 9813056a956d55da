#include "core/axis.h"

#include "core/axis_path.h"
#include "core/fixed.h"

static bool has_flag(const struct axis_state *state, uint32_t flag)
{
    return (state->target.flags & flag) != 0;
}

static void set_flag_if(struct axis_state *state, bool condition, uint32_t flag)
{
    if (condition)
        state->target.flags |= flag;
}

void axis_start(struct axis_state *state)
{
    path_start(&state->path);
    pid_reset(&state->pid);
    state->compensation.primed = 0;
    state->target.flags = 0;
    state->watch = (struct watch_state){0};
    state->join.step_turn64 = 0;
    state->near_ticks = 0;
    state->filter.primed = 0;
    oscillation_start(&state->oscillation);
    state->drive = DRIVE_PATH;
}

void axis_set_reference(const struct axis_config *config, const struct axis_model *model, struct axis_state *state)
{
    bool saturated = false;
    state->target.reference = path_now(&config->path, &state->path, model->wave_q30, &saturated);
}

bool axis_needs_target(const struct axis_state *state)
{
    return state->drive == DRIVE_PATH && !has_flag(state, TARGET_READY);
}

/* Modes this firmware does not know, or cannot run without what the model lacks, hold the output. */
static bool can_follow_path(const struct axis_config *config, const struct axis_model *model)
{
    if (axis_mode_uses_tables(config->mode))
        return path_is_periodic(&config->path) || model->tables != NULL;
    if (axis_mode_inverts(config->mode))
        return model->compensation != NULL;
    return config->mode == AXIS_OPEN || config->mode == AXIS_PID;
}

bool axis_set_target(const struct axis_config *config, const struct axis_model *model, struct axis_state *state)
{
    struct axis_target *target = &state->target;
    const bool follows = can_follow_path(config, model), inverts = follows && axis_mode_inverts(config->mode);
    bool saturated = false;
    const struct axis_wanted wanted = axis_wanted(config, model, state, follows, &saturated);
    target->reference = wanted.reference;
    target->feedforward_q24 = wanted.feedforward_q24;
    if (inverts)
        target->ahead_q16 = sat_sub_i32(wanted.ahead_q16, model->compensation->rest_q16, &saturated);
    target->flags = TARGET_READY;
    set_flag_if(state, inverts, TARGET_INVERSE);
    set_flag_if(state, saturated, TARGET_SATURATED);
    set_flag_if(state, follows, TARGET_FOLLOWS_PATH);
    set_flag_if(state, follows && axis_mode_has_feedback(config->mode), TARGET_FEEDBACK);
    set_flag_if(state, follows && axis_path_advance(config, state), TARGET_PATH_DONE);
    return inverts;
}

void axis_invert(const struct axis_config *config, const struct axis_model *model, struct axis_state *state,
                 int32_t ahead_q16)
{
    const int32_t before_q24 = state->compensation.inverse.v_q24, most_q24 = config->output.slew_q24;
    bool saturated = false;
    int32_t wanted_q16 = sat_add_i32(ahead_q16, model->compensation->rest_q16, &saturated);
    state->target.feedforward_q24 =
        compensation_step_q24(model->compensation, &state->compensation, wanted_q16, most_q24, &saturated);
    set_flag_if(state, saturated, TARGET_SATURATED);
    const uint64_t way_q24 = magnitude_i64((int64_t)state->compensation.inverse.v_q24 - before_q24);
    set_flag_if(state, saturated && way_q24 >= (uint32_t)most_q24, TARGET_LIMITED);
}

void axis_lead_by(const struct axis_model *model, struct axis_state *state, int32_t way_q16)
{
    bool saturated = false;
    if (model->compensation == NULL)
        return;
    const int32_t lead_q24 = mul_shift_i32(way_q16, model->compensation->per_um_q28, 20, &saturated);
    state->target.feedforward_q24 = sat_add_i32(state->target.feedforward_q24, lead_q24, &saturated);
    set_flag_if(state, saturated, TARGET_SATURATED);
}

bool axis_has_feedback(const struct axis_state *state)
{
    return state->drive == DRIVE_PATH && has_flag(state, TARGET_FEEDBACK);
}

int32_t axis_error_q16(const struct axis_config *config, struct axis_state *state, uint16_t adc_code)
{
    bool saturated = false;
    int32_t position_q16 = converter_position_q16(&config->converter, adc_code, &saturated);
    int32_t error_q16 = sat_sub_i32(state->target.reference, position_q16, &saturated);
    set_flag_if(state, saturated, TARGET_SATURATED);
    return error_q16;
}

static int32_t feedback_q24(const struct axis_config *config, struct axis_state *state, int32_t error_q16,
                            bool *saturated)
{
    if (!has_flag(state, TARGET_FEEDBACK))
        return 0;
    if (state->pid.primed == 0)
        pid_preset(&config->pid, &state->pid, error_q16, state->u_q24, state->target.feedforward_q24);
    const int32_t u_q24 = pid_step_q24(&config->pid, &state->pid, error_q16, saturated);
    return loop_filter_step_q24(&config->filter, &state->filter, u_q24, saturated);
}

/* Slew limit and clamp, with anti-windup for what they cut off. */
static int32_t limit_q24(const struct axis_config *config, struct axis_state *state, int32_t forward_q24,
                         int32_t back_q24, bool *limited)
{
    *limited = false;
    int32_t wanted_q24 = sat_add_i32(forward_q24, back_q24, limited);
    int32_t u_q24 = output_limit_q24(&config->output, state->u_q24, wanted_q24, limited);
    if (*limited)
        pid_unwind(&state->pid, u_q24 - ((int64_t)forward_q24 + back_q24));
    return u_q24;
}

static void follow_path(const struct axis_config *config, struct axis_state *state, int32_t error_q16, bool *saturated,
                        struct axis_trace *trace)
{
    trace->path_done = has_flag(state, TARGET_PATH_DONE);
    trace->inverted = has_flag(state, TARGET_INVERSE);
    *saturated = has_flag(state, TARGET_SATURATED);
    trace->feedforward_q24 = state->target.feedforward_q24;
    trace->feedback_q24 = feedback_q24(config, state, error_q16, saturated);
    state->u_q24 = limit_q24(config, state, trace->feedforward_q24, trace->feedback_q24, &trace->limited);
    trace->limited = trace->limited || has_flag(state, TARGET_LIMITED);
    *saturated = *saturated || trace->limited;
}

/* True: the output stands still and will stay so. */
static bool hold_or_ramp(const struct axis_config *config, struct axis_state *state, bool *saturated)
{
    const int32_t before_q24 = state->u_q24;
    int32_t wanted_q24 = before_q24;
    if (state->drive == DRIVE_RAMP)
        wanted_q24 = output_ramp_q24(before_q24, config->u_park_q24, config->ramp_q24);
    state->u_q24 = output_limit_q24(&config->output, before_q24, wanted_q24, saturated);
    return state->drive != DRIVE_PATH && state->u_q24 == before_q24;
}

bool axis_step(const struct axis_config *config, struct axis_state *state, int32_t error_q16, struct axis_trace *trace)
{
    bool saturated = false, rests = false;
    *trace = (struct axis_trace){.reference = state->target.reference};
    if (state->drive == DRIVE_PATH && has_flag(state, TARGET_FOLLOWS_PATH))
        follow_path(config, state, error_q16, &saturated, trace);
    else
        rests = hold_or_ramp(config, state, &saturated);
    state->target.flags = 0;
    trace->dac_code = converter_dac_code(&config->converter, state->u_q24, &saturated);
    if (saturated)
        state->saturations++;
    return rests;
}

enum watch_finding axis_watch(const struct axis_config *config, struct axis_state *state, uint16_t adc_code,
                              int32_t error_q16, const struct axis_trace *trace)
{
    const struct output_config *output = &config->output;
    const struct watch_config watch = {.error_limit_q16 = config->error_limit_q16,
                                       .error_ticks = config->error_ticks,
                                       .u_range_q24 = (uint32_t)output->u_max_q24 - (uint32_t)output->u_min_q24};
    const struct watch_tick tick = {
        .adc_code = adc_code, .limited = trace->limited, .u_q24 = state->u_q24, .error_q16 = error_q16};
    bool runs_away = oscillation_step(&state->oscillation, config->oscillation_limit_q16, error_q16, trace->reference);
    enum watch_finding found = watch_step(&watch, &state->watch, &tick);
    return runs_away ? WATCH_OSCILLATION : found;
}

enum watch_finding axis_watch_codes(const struct axis_config *config, struct axis_state *state, uint16_t adc_code)
{
    const struct output_config *output = &config->output;
    const struct watch_config watch = {.u_range_q24 = (uint32_t)output->u_max_q24 - (uint32_t)output->u_min_q24};
    const struct watch_tick tick = {.adc_code = adc_code, .u_q24 = state->u_q24};
    return watch_codes(&watch, &state->watch, &tick);
}

bool axis_watch_range(const struct axis_config *config, struct axis_state *state, uint16_t adc_code)
{
    return watch_range(&state->watch, adc_code, config->code_min, config->code_max);
}

void axis_watch_target(const struct axis_config *config, struct axis_state *state, uint16_t adc_code,
                       const struct axis_trace *trace)
{
    bool saturated = false;
    const int32_t position_q16 = converter_position_q16(&config->converter, adc_code, &saturated);
    if (magnitude_i64((int64_t)trace->reference - position_q16) > (uint32_t)config->window_q16)
        state->near_ticks = 0;
    else if (state->near_ticks != UINT32_MAX)
        state->near_ticks++;
}

bool axis_is_on_target(const struct axis_config *config, const struct axis_state *state)
{
    return state->drive == DRIVE_PATH && config->mode != AXIS_OPEN && state->near_ticks != 0 &&
           state->near_ticks >= config->window_ticks;
}

bool axis_follow_output(const struct axis_model *model, struct axis_state *state, const struct axis_trace *trace)
{
    const struct compensation *compensation = model->compensation;
    if (compensation == NULL || trace->inverted)
        return false;
    compensation_follow(compensation, &state->compensation, state->u_q24);
    return creep_is_in_use(&compensation->creep);
}
