#include "core/axis.h"

#include "core/fixed.h"

void axis_start(const struct axis_config *config, struct axis_state *state)
{
    (void)config;
    path_start(&state->path);
    pid_reset(&state->pid);
    state->drive = DRIVE_PATH;
}

static bool is_periodic(const struct path_config *path)
{
    return path->kind == PATH_SINE || path->kind == PATH_WAVE;
}

/* Position looked up at the phase lead and divided by the gain; a hold or a move is slow, so it needs no lead. */
static int32_t feedforward_q24(const struct axis_config *config, const struct feedforward_tables *tables,
                               const int32_t *wave_q30, const struct axis_state *state, int32_t reference_q16,
                               bool *saturated)
{
    if (!is_periodic(&config->path))
        return feedforward_static_q24(tables, reference_q16);
    int32_t ahead_q16 = path_ahead(&config->path, &state->path, wave_q30, config->point.lead_turn32, 0, saturated);
    return feedforward_step_q24(&config->point, ahead_q16, saturated);
}

static int32_t feedback_q24(const struct axis_config *config, struct axis_state *state, int32_t error_q16,
                            int32_t ff_q24, bool *saturated)
{
    if (state->pid.primed == 0)
        pid_preset(&config->pid, &state->pid, error_q16, state->u_q24, ff_q24);
    return pid_step_q24(&config->pid, &state->pid, error_q16, saturated);
}

/* What the path asks for; the output block has the last word. */
static int64_t follow_path_q24(const struct axis_config *config, const struct feedforward_tables *tables,
                               const int32_t *wave_q30, struct axis_state *state, int32_t position_q16,
                               struct axis_trace *trace, bool *saturated)
{
    bool ff = config->mode == AXIS_FF || config->mode == AXIS_FF_PID;
    bool fb = config->mode == AXIS_PID || config->mode == AXIS_FF_PID;
    if (config->mode == AXIS_OPEN)
        trace->feedforward_q24 = trace->reference; /* in this mode the path is volts */
    if (ff)
        trace->feedforward_q24 = feedforward_q24(config, tables, wave_q30, state, trace->reference, saturated);
    if (fb) {
        int32_t error_q16 = sat_i32((int64_t)trace->reference - position_q16, saturated);
        trace->feedback_q24 = feedback_q24(config, state, error_q16, trace->feedforward_q24, saturated);
    }
    return (int64_t)trace->feedforward_q24 + trace->feedback_q24;
}

/* Modes this firmware cannot run, or not without tables, hold the output. */
static bool can_follow(const struct axis_config *config, const struct feedforward_tables *tables)
{
    switch (config->mode) {
    case AXIS_OPEN:
    case AXIS_PID:
        return true;
    case AXIS_FF:
    case AXIS_FF_PID:
        return is_periodic(&config->path) || tables != NULL;
    default:
        return false;
    }
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

void axis_step(const struct axis_config *config, const struct feedforward_tables *tables, const int32_t *wave_q30,
               struct axis_state *state, uint16_t adc_code, struct axis_trace *trace)
{
    bool saturated = false;
    bool follows = state->drive == DRIVE_PATH && can_follow(config, tables);
    *trace = (struct axis_trace){.adc_code = adc_code};
    trace->reference = path_now(&config->path, &state->path, wave_q30, &saturated);
    count_rails(state, adc_code);

    int64_t asked_q24 = state->u_q24;
    if (follows) {
        int32_t position_q16 = converter_position_q16(&config->converter, adc_code, &saturated);
        asked_q24 = follow_path_q24(config, tables, wave_q30, state, position_q16, trace, &saturated);
    } else if (state->drive == DRIVE_RAMP) {
        asked_q24 = toward_park_q24(config, state);
    }
    state->u_q24 = output_limit_q24(&config->output, state->u_q24, sat_i32(asked_q24, &saturated), &saturated);
    if (follows) {
        pid_unwind(&state->pid, state->u_q24 - asked_q24);
        trace->path_done = path_advance(&config->path, &state->path);
    }
    trace->dac_code = converter_dac_code(&config->converter, state->u_q24, &saturated);
    if (saturated)
        state->saturations++;
}
