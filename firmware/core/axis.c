#include "core/axis.h"

#include "core/fixed.h"

bool axis_mode_closes(uint32_t mode)
{
    return mode == AXIS_PID || mode == AXIS_FF_PID || mode == AXIS_INVERSE_PID;
}

bool axis_mode_inverts(uint32_t mode)
{
    return mode == AXIS_INVERSE || mode == AXIS_INVERSE_PID;
}

bool axis_mode_uses_tables(uint32_t mode)
{
    return mode == AXIS_FF || mode == AXIS_FF_PID;
}

void axis_start(const struct axis_config *config, struct axis_state *state)
{
    (void)config;
    path_start(&state->path);
    pid_reset(&state->pid);
    state->compensation.primed = 0;
    state->drive = DRIVE_PATH;
}

static bool is_periodic(const struct path_config *path)
{
    return path->kind == PATH_SINE || path->kind == PATH_WAVE;
}

/* Modes this firmware does not know, or cannot run without what the model lacks, hold the output. */
static bool can_follow(const struct axis_config *config, const struct axis_model *model)
{
    if (axis_mode_uses_tables(config->mode))
        return is_periodic(&config->path) || model->tables != NULL;
    if (axis_mode_inverts(config->mode))
        return model->compensation != NULL;
    return config->mode == AXIS_OPEN || config->mode == AXIS_PID;
}

void axis_aim(const struct axis_config *config, const struct axis_model *model, const struct axis_state *state,
              uint16_t adc_code, struct axis_aim *aim)
{
    *aim = (struct axis_aim){.follows = state->drive == DRIVE_PATH && can_follow(config, model)};
    aim->inverts = aim->follows && axis_mode_inverts(config->mode);
    aim->closes = aim->follows && axis_mode_closes(config->mode);
    aim->reference = path_now(&config->path, &state->path, model->wave_q30, &aim->saturated);
    if (aim->inverts) {
        int64_t ahead_q16 = path_ahead(&config->path, &state->path, model->wave_q30, config->point.lead_turn32,
                                       model->compensation->preview_ticks_q16, &aim->saturated);
        aim->ahead_q16 = sat_i32(ahead_q16 - model->compensation->rest_q16, &aim->saturated);
    }
    if (aim->closes) {
        int64_t position_q16 = converter_position_q16(&config->converter, adc_code, &aim->saturated);
        aim->error_q16 = sat_i32(aim->reference - position_q16, &aim->saturated);
    }
}

/* Position looked up at the phase lead and divided by the gain; a hold or a move is slow, so it needs no lead. */
static int32_t table_feedforward_q24(const struct axis_config *config, const struct axis_model *model,
                                     const struct axis_state *state, int32_t reference_q16, bool *saturated)
{
    if (!is_periodic(&config->path))
        return feedforward_static_q24(model->tables, reference_q16);
    int32_t ahead_q16 =
        path_ahead(&config->path, &state->path, model->wave_q30, config->point.lead_turn32, 0, saturated);
    return feedforward_step_q24(&config->point, ahead_q16, saturated);
}

static int32_t feedforward_q24(const struct axis_config *config, const struct axis_model *model,
                               struct axis_state *state, const struct axis_aim *aim, bool *saturated)
{
    if (aim->inverts) {
        int32_t ahead_q16 = sat_i32((int64_t)aim->ahead_q16 + model->compensation->rest_q16, saturated);
        return compensation_step_q24(model->compensation, &state->compensation, ahead_q16, saturated);
    }
    if (axis_mode_uses_tables(config->mode))
        return table_feedforward_q24(config, model, state, aim->reference, saturated);
    return config->mode == AXIS_OPEN ? aim->reference : 0; /* in mode open the path is volts */
}

static int32_t feedback_q24(const struct axis_config *config, struct axis_state *state, int32_t error_q16,
                            int32_t ff_q24, bool *saturated)
{
    if (state->pid.primed == 0)
        pid_preset(&config->pid, &state->pid, error_q16, state->u_q24, ff_q24);
    return pid_step_q24(&config->pid, &state->pid, error_q16, saturated);
}

static int64_t toward_park_q24(const struct axis_config *config, const struct axis_state *state)
{
    int64_t way_q24 = (int64_t)config->u_park_q24 - state->u_q24;
    if (way_q24 > config->ramp_q24)
        way_q24 = config->ramp_q24;
    else if (way_q24 < -(int64_t)config->ramp_q24)
        way_q24 = -(int64_t)config->ramp_q24;
    return state->u_q24 + way_q24;
}

static void count_rails(struct axis_state *state, uint16_t adc_code)
{
    bool at_rail = adc_code == 0 || adc_code == UINT16_MAX;
    if (!at_rail)
        state->rail_ticks = 0;
    else if (state->rail_ticks != UINT32_MAX)
        state->rail_ticks++;
}

void axis_step(const struct axis_config *config, const struct axis_model *model, struct axis_state *state,
               const struct axis_aim *aim, uint16_t adc_code, struct axis_trace *trace)
{
    bool saturated = aim->saturated;
    *trace = (struct axis_trace){.adc_code = adc_code, .reference = aim->reference};
    count_rails(state, adc_code);

    int64_t asked_q24 = state->u_q24;
    if (aim->follows) {
        trace->feedforward_q24 = feedforward_q24(config, model, state, aim, &saturated);
        if (aim->closes)
            trace->feedback_q24 = feedback_q24(config, state, aim->error_q16, trace->feedforward_q24, &saturated);
        asked_q24 = (int64_t)trace->feedforward_q24 + trace->feedback_q24;
    } else if (state->drive == DRIVE_RAMP) {
        asked_q24 = toward_park_q24(config, state);
    }
    state->u_q24 = output_limit_q24(&config->output, state->u_q24, sat_i32(asked_q24, &saturated), &saturated);
    if (aim->follows) {
        pid_unwind(&state->pid, state->u_q24 - asked_q24);
        trace->path_done = path_advance(&config->path, &state->path);
    }
    if (model->compensation != NULL && !aim->inverts)
        compensation_follow(model->compensation, &state->compensation, state->u_q24);
    trace->dac_code = converter_dac_code(&config->converter, state->u_q24, &saturated);
    if (saturated)
        state->saturations++;
}
