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
    state->aim.flags = 0;
    state->rail_ticks = 0;
    state->drive = DRIVE_PATH;
}

void axis_set_reference(const struct axis_config *config, const struct axis_model *model, struct axis_state *state)
{
    bool saturated = false;
    state->aim.reference = path_now(&config->path, &state->path, model->wave_q30, &saturated);
}

static bool is_periodic(const struct path_config *path)
{
    return path->kind == PATH_SINE || path->kind == PATH_WAVE;
}

static uint32_t if_set(bool condition, uint32_t flag)
{
    return condition ? flag : 0;
}

static bool aim_of_inverse(const struct axis_model *model, struct axis_aim *aim, int32_t ahead_q16, bool *saturated)
{
    if (model->compensation == NULL)
        return false;
    aim->ahead_q16 = sat_sub_i32(ahead_q16, model->compensation->rest_q16, saturated);
    return true;
}

static inline bool looks_ahead(uint32_t mode)
{
    _Static_assert(AXIS_FF_PID == AXIS_FF + 1 && AXIS_INVERSE == AXIS_FF + 2 && AXIS_INVERSE_PID == AXIS_FF + 3,
                   "one comparison tells");
    return mode - AXIS_FF <= AXIS_INVERSE_PID - AXIS_FF;
}

/* A path that comes round is looked up at the phase lead too: divided by the gain, or as what the inverse is of.
 * Returns whether the axis follows its path. */
static inline bool aim_led(const struct axis_config *config, const struct axis_model *model, struct axis_state *state,
                           bool *inverts, bool *saturated)
{
    struct path_pair path =
        path_now_and_led(&config->path, &state->path, model->wave_q30, config->point.lead_turn32, saturated);
    state->aim.reference = path.now;
    if (axis_mode_uses_tables(config->mode)) {
        state->aim.feedforward_q24 = feedforward_step_q24(&config->point, path.led, saturated);
        return true;
    }
    state->aim.feedforward_q24 = 0;
    *inverts = aim_of_inverse(model, &state->aim, path.led, saturated);
    return *inverts;
}

/* What does not follow from now and a phase lead. Returns whether the axis follows its path. */
static inline bool aim_otherwise(const struct axis_config *config, const struct axis_model *model,
                                 struct axis_state *state, bool *inverts, bool *saturated)
{
    const uint32_t mode = config->mode;
    struct axis_aim *aim = &state->aim;
    aim->feedforward_q24 = 0;
    aim->reference = path_now(&config->path, &state->path, model->wave_q30, saturated);
    if (axis_mode_uses_tables(mode)) { /* a hold or a move is slow, so it needs no lead */
        if (model->tables == NULL)
            return false;
        aim->feedforward_q24 = feedforward_static_q24(model->tables, aim->reference);
        return true;
    }
    if (axis_mode_inverts(mode)) {
        if (model->compensation != NULL) {
            int32_t ahead_q16 = path_ahead(&config->path, &state->path, model->wave_q30, config->point.lead_turn32,
                                           model->compensation->preview_ticks_q16, saturated);
            *inverts = aim_of_inverse(model, aim, ahead_q16, saturated);
        }
        return *inverts;
    }
    if (mode == AXIS_OPEN)
        aim->feedforward_q24 = aim->reference; /* the path is volts */
    return mode == AXIS_OPEN || mode == AXIS_PID;
}

/* Modes this firmware does not know, or cannot run without what the model lacks, hold the output. */
bool axis_aim(const struct axis_config *config, const struct axis_model *model, struct axis_state *state)
{
    const uint32_t mode = config->mode;
    struct axis_aim *aim = &state->aim;
    bool saturated, inverts = false, follows;
    if (looks_ahead(mode) && is_periodic(&config->path)) {
        bool beyond = false; /* its own, which no call from here sees: it stays in a register */
        follows = aim_led(config, model, state, &inverts, &beyond);
        saturated = beyond;
    } else {
        bool beyond = false;
        follows = aim_otherwise(config, model, state, &inverts, &beyond);
        saturated = beyond;
    }
    uint32_t flags = AIM_READY | if_set(inverts, AIM_INVERTS) | if_set(saturated, AIM_SATURATED);
    if (follows)
        flags |= AIM_FOLLOWS | (uint32_t)axis_mode_closes(mode) * AIM_CLOSES |
                 if_set(path_advance(&config->path, &state->path), AIM_PATH_DONE);
    aim->flags = flags;
    return inverts;
}

void axis_feed(const struct axis_model *model, struct axis_state *state, int32_t ahead_q16)
{
    bool saturated = false;
    int32_t wanted_q16 = sat_add_i32(ahead_q16, model->compensation->rest_q16, &saturated);
    state->aim.feedforward_q24 =
        compensation_step_q24(model->compensation, &state->compensation, wanted_q16, &saturated);
    state->aim.flags |= if_set(saturated, AIM_SATURATED);
}

int32_t axis_error_q16(const struct axis_config *config, struct axis_state *state, uint16_t adc_code)
{
    bool saturated = false;
    int32_t position_q16 = converter_position_q16(&config->converter, adc_code, &saturated);
    int32_t error_q16 = sat_sub_i32(state->aim.reference, position_q16, &saturated);
    if (saturated)
        state->aim.flags |= AIM_SATURATED;
    return error_q16;
}

static int32_t feedback_q24(const struct axis_config *config, struct axis_state *state, int32_t error_q16,
                            bool *saturated)
{
    if (state->pid.primed == 0)
        pid_preset(&config->pid, &state->pid, error_q16, state->u_q24, state->aim.feedforward_q24);
    return pid_step_q24(&config->pid, &state->pid, error_q16, saturated);
}

static int32_t toward_park_q24(const struct axis_config *config, const struct axis_state *state)
{
    int32_t way_q24 = sub_i32(config->u_park_q24, state->u_q24);
    return add_i32(state->u_q24, clamp_i32(way_q24, sub_i32(0, config->ramp_q24), config->ramp_q24));
}

static void count_rails(struct axis_state *state, uint16_t adc_code)
{
    bool at_rail = (uint16_t)(adc_code + 1u) <= 1;
    if (!at_rail)
        state->rail_ticks = 0;
    else if (state->rail_ticks != UINT32_MAX)
        state->rail_ticks++;
}

/* Where the path wants the output; the slew limit and the clamp have their say, and the integrator hears of it. */
static void follow(const struct axis_config *config, struct axis_state *state, int32_t error_q16, bool *saturated,
                   struct axis_trace *trace)
{
    const uint32_t flags = state->aim.flags;
    trace->feedforward_q24 = state->aim.feedforward_q24;
    if ((flags & (AIM_PATH_DONE | AIM_INVERTS)) != 0) {
        trace->path_done = (flags & AIM_PATH_DONE) != 0;
        trace->inverted = (flags & AIM_INVERTS) != 0;
    }
    *saturated = (flags & AIM_SATURATED) != 0;
    const int32_t feedforward_q24 = trace->feedforward_q24;
    int32_t feedback = 0;
    bool beyond = false;
    if ((flags & AIM_CLOSES) != 0)
        feedback = feedback_q24(config, state, error_q16, saturated);
    trace->feedback_q24 = feedback;
    int32_t wanted_q24 = sat_add_i32(feedforward_q24, feedback, &beyond);
    const bool overflows = beyond;
    int32_t u_q24 = output_limit_q24(&config->output, state->u_q24, wanted_q24, &beyond);
    state->u_q24 = u_q24;
    if (beyond) {
        *saturated = true;
        pid_unwind(&state->pid,
                   overflows ? u_q24 - ((int64_t)feedforward_q24 + feedback) : (int64_t)u_q24 - wanted_q24);
    }
}

bool axis_step(const struct axis_config *config, struct axis_state *state, uint16_t adc_code, int32_t error_q16,
               struct axis_trace *trace)
{
    bool saturated = false, rests = false;
    trace->reference = state->aim.reference;
    trace->path_done = trace->inverted = false;
    if (state->drive == DRIVE_PATH && (state->aim.flags & AIM_FOLLOWS) != 0) {
        count_rails(state, adc_code);
        follow(config, state, error_q16, &saturated, trace);
    } else {
        trace->feedforward_q24 = trace->feedback_q24 = 0;
        bool ramps = state->drive == DRIVE_RAMP && state->u_q24 != config->u_park_q24;
        int32_t asked_q24 = ramps ? toward_park_q24(config, state) : state->u_q24;
        int32_t before_q24 = state->u_q24;
        state->u_q24 = output_limit_q24(&config->output, before_q24, asked_q24, &saturated);
        rests = state->drive != DRIVE_PATH && state->u_q24 == before_q24;
    }
    state->aim.flags = 0;
    trace->dac_code = converter_dac_code(&config->converter, state->u_q24, &saturated);
    if (saturated)
        state->saturations++;
    return rests;
}

bool axis_settle(const struct axis_model *model, struct axis_state *state, const struct axis_trace *trace)
{
    const struct compensation *compensation = model->compensation;
    if (compensation == NULL || trace->inverted)
        return false;
    compensation_follow(compensation, &state->compensation, state->u_q24);
    return compensation->creep.fours != 0;
}
