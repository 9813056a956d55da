/* What tests need beside the core itself: its inline functions as symbols, loops that would be slow through ctypes,
 * and, with HARNESS_MAIN, a program that runs a scenario from stdin, so that a sanitizer may abort it and several
 * builds can be compared byte by byte. */
#include <stdio.h>
#include <stdlib.h>

#include "core/axis.h"
#include "core/decouple.h"
#include "core/extremes.h"
#include "core/feedforward_tables.h"
#include "core/fixed.h"
#include "core/inverse_make.h"
#include "core/sine.h"

int64_t h_floor_shift_i64(int64_t value, unsigned bits)
{
    return floor_shift_i64(value, bits);
}

int64_t h_round_shift_i64(int64_t value, unsigned bits)
{
    return round_shift_i64(value, bits);
}

int32_t h_sat_i32(int64_t value, bool *saturated)
{
    return sat_i32(value, saturated);
}

int64_t h_sat_add_i64(int64_t a, int64_t b, bool *saturated)
{
    return sat_add_i64(a, b, saturated);
}

int64_t h_sat_between_i64(int64_t value, int64_t low, int64_t high, bool *saturated)
{
    return sat_between_i64(value, low, high, saturated);
}

int64_t h_sat_power_i64(int64_t value, unsigned bits, bool *saturated)
{
    return sat_power_i64(value, bits, saturated);
}

int64_t h_sat_below_power_i64(int64_t value, unsigned bits, bool *saturated)
{
    return sat_below_power_i64(value, bits, saturated);
}

int32_t h_sat_add_i32(int32_t a, int32_t b, bool *saturated)
{
    return sat_add_i32(a, b, saturated);
}

int32_t h_sat_sub_i32(int32_t a, int32_t b, bool *saturated)
{
    return sat_sub_i32(a, b, saturated);
}

int32_t h_sat_i16(int32_t value)
{
    return sat_i16(value);
}

unsigned h_leading_zeros_u32(uint32_t value)
{
    return leading_zeros_u32(value);
}

unsigned h_leading_zeros_portable_u32(uint32_t value)
{
    return leading_zeros_portable_u32(value);
}

unsigned h_trailing_zeros_u32(uint32_t value)
{
    return trailing_zeros_u32(value);
}

int32_t h_mul_high_i32(int32_t a, int32_t b)
{
    return mul_high_i32(a, b);
}

int32_t h_mul_high_round_i32(int32_t a, int32_t b)
{
    return mul_high_round_i32(a, b);
}

int32_t h_mul_shift_i32(int32_t a, int32_t b, unsigned bits, bool *saturated)
{
    return mul_shift_i32(a, b, bits, saturated);
}

int64_t h_mul_shift_i64(int64_t a, int64_t b, unsigned bits, bool *saturated)
{
    return mul_shift_i64(a, b, bits, saturated);
}

uint64_t h_mul_wide_u64(uint64_t a, uint64_t b, uint64_t *low)
{
    return mul_wide_u64(a, b, low);
}

int32_t h_lerp_i32(int32_t a, int32_t b, uint32_t fraction_q30)
{
    return lerp_i32(a, b, fraction_q30);
}

int32_t h_clamp_i32(int32_t value, int32_t low, int32_t high)
{
    return clamp_i32(value, low, high);
}

int64_t h_add_mul_shift64_i64(int64_t sum, int64_t a, int64_t b)
{
    return add_mul_shift64_i64(sum, a, b);
}

int32_t h_add_i32(int32_t a, int32_t b)
{
    return add_i32(a, b);
}

int32_t h_sub_i32(int32_t a, int32_t b)
{
    return sub_i32(a, b);
}

int32_t h_round_shift_i32(int32_t value, unsigned bits)
{
    return round_shift_i32(value, bits);
}

uint32_t h_ratio_u32(uint64_t a, uint32_t b)
{
    return ratio_u32(a, b);
}

/* A cascade primed with the first value, in place. */
void h_biquad_many(const struct biquad_config *sections, size_t count, int64_t *values_q40, size_t n)
{
    struct biquad_state states[16];
    for (size_t k = 0; k < count; k++)
        biquad_prime(&states[k], values_q40[0]);
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < count; k++) {
            bool saturated = false;
            values_q40[i] = biquad_step_q40(&sections[k], &states[k], values_q40[i], &saturated);
        }
}

void h_inverse_many(const struct inverse_config *config, struct inverse_state *state, const int64_t *x_q44,
                    int32_t *v_q24, size_t n)
{
    bool saturated = false;
    for (size_t i = 0; i < n; i++)
        v_q24[i] = inverse_step_q24(config, state, x_q44[i], INT32_MAX, &saturated);
}

/* Displacements with creep to those without, in place. */
void h_creep_many(const struct creep_config *given, struct creep_state *state, int64_t *x_q40, size_t n)
{
    struct creep_config made = *given;
    const struct creep_config *config = &made;
    creep_make(&made);
    for (size_t i = 0; i < n; i++) {
        x_q40[i] = creep_undo_q40(config, state, x_q40[i]);
        creep_follow(config, state, x_q40[i]);
    }
}

void h_sine_many(const uint32_t *phases_turn32, int32_t *out_q30, size_t n)
{
    for (size_t i = 0; i < n; i++)
        out_q30[i] = sine_q30(phases_turn32[i]);
}

void h_extremes_follow(struct extremes *extremes, int32_t v_q24)
{
    extremes_follow(extremes, v_q24);
}

size_t h_sizeof(int which)
{
    const size_t sizes[] = {
        sizeof(struct axis_config),        sizeof(struct axis_state),         sizeof(struct axis_trace),
        sizeof(struct feedforward_model),  sizeof(struct feedforward_tables), sizeof(struct path_config),
        sizeof(struct path_state),         sizeof(struct pid_state),          sizeof(struct compensation),
        sizeof(struct compensation_state), sizeof(struct decoupling),         sizeof(struct axis_target),
        sizeof(struct watch_state),        sizeof(struct watch_config),       sizeof(struct watch_tick),
        sizeof(struct loop_filter_config), sizeof(struct loop_filter_state)};
    return sizes[which];
}

/* One tick of a scenario. `command`: an axis_drive to set, 3 for axis_start, 4 for leaving things as they are. */
struct tick {
    uint16_t adc_code;
    uint16_t command;
};

static void find_target(const struct axis_config *config, const struct axis_model *model, struct axis_state *state)
{
    if (axis_needs_target(state) && axis_set_target(config, model, state))
        axis_invert(config, model, state, state->target.ahead_q16);
}

/* What a device does of an axis that is alone. */
void h_run(const struct axis_config *config, const struct axis_model *model, struct axis_state *state,
           const struct tick *ticks, struct axis_trace *traces, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (ticks[i].command < 3)
            state->drive = ticks[i].command;
        else if (ticks[i].command == 3)
            axis_start(state);
        find_target(config, model, state);
        int32_t error_q16 = axis_has_feedback(state) ? axis_error_q16(config, state, ticks[i].adc_code) : 0;
        axis_step(config, state, error_q16, &traces[i]);
        axis_follow_output(model, state, &traces[i]);
    }
}

#ifdef HARNESS_MAIN
static void take(void *into, size_t size)
{
    if (fread(into, 1, size, stdin) != size)
        exit(3);
}

static void give(int64_t value)
{
    printf("%lld\n", (long long)value);
}

static void give_trace(const struct axis_trace *trace, const struct axis_state *state)
{
    give(trace->reference);
    give(trace->feedforward_q24);
    give(trace->feedback_q24);
    give(trace->dac_code);
    give(trace->path_done);
    give(state->u_q24);
    give(state->saturations);
    give(state->pid.integral_q48);
    give(state->pid.derivative_q40);
    give(state->compensation.inverse.v_q24);
    give(state->compensation.creep.lag_q40[0]);
}

/* What a device would check: with anything else a section is passed over, the rest not used at all. */
static bool usable(struct compensation *compensation, const int32_t play_w_q20[INVERSE_PLAYS])
{
    for (unsigned i = 0; i < SHAPE_SECTIONS; i++)
        if (!biquad_is_usable(&compensation->shape[i]))
            compensation->shape[i] = (struct biquad_config){.b0_q26 = BIQUAD_ONE_Q26};
    if (!biquad_is_usable(&compensation->drive))
        compensation->drive = (struct biquad_config){.b0_q26 = BIQUAD_ONE_Q26};
    if (!creep_make(&compensation->creep) || inverse_make(&compensation->inverse, play_w_q20) != INVERSE_EXISTS)
        return false;
    int32_t rest_q16 = compensation->rest_q16;
    bool fits = compensation_make(compensation);
    compensation->rest_q16 = rest_q16; /* any will do */
    compensation->rest_q40 = rest_q16 * ((int64_t)1 << 24);
    return fits;
}

int main(void)
{
    static struct feedforward_tables tables;
    static struct compensation compensation;
    struct feedforward_model law;
    struct axis_config config;
    static int32_t wave_q30[WAVE_POINTS], play_w_q20[INVERSE_PLAYS];
    uint32_t scenarios, n;
    take(&scenarios, sizeof scenarios);
    for (uint32_t scenario = 0; scenario < scenarios; scenario++) {
        struct axis_state state = {0};
        int32_t range_f[2];
        take(&config, sizeof config);
        if (!loop_filter_is_usable(&config.filter))
            config.filter.in_use = 0;
        take(&law, sizeof law);
        take(&compensation, sizeof compensation);
        take(play_w_q20, sizeof play_w_q20);
        take(wave_q30, sizeof wave_q30);
        take(range_f, sizeof range_f);
        take(&state.compensation, sizeof state.compensation);
        take(&n, sizeof n);
        enum feedforward_verdict verdict = feedforward_expand(&law, &tables);
        bool covered = verdict == FF_OK && feedforward_lookup(&tables, range_f[0], range_f[1], &config.point);
        bool inverse = usable(&compensation, play_w_q20);
        if (inverse)
            compensation_admit(&compensation, &state.compensation);
        give((int64_t)verdict * 4 + covered * 2 + inverse);
        struct axis_model model = {verdict == FF_OK ? &tables : NULL, inverse ? &compensation : NULL, wave_q30};
        for (uint32_t i = 0; i < n; i++) {
            struct tick tick;
            struct axis_trace trace;
            take(&tick, sizeof tick);
            h_run(&config, &model, &state, &tick, &trace, 1);
            give_trace(&trace, &state);
        }
    }
    return 0;
}
#endif
