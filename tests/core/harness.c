/* What tests need beside the core itself: its inline functions as symbols, loops that would be slow through ctypes,
 * and, with HARNESS_MAIN, a program that runs a scenario from stdin, so that a sanitizer may abort it and several
 * builds can be compared byte by byte. */
#include <stdio.h>
#include <stdlib.h>

#include "core/axis.h"
#include "core/fixed.h"
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

void h_sine_many(const uint32_t *phases_turn32, int32_t *out_q30, size_t n)
{
    for (size_t i = 0; i < n; i++)
        out_q30[i] = sine_q30(phases_turn32[i]);
}

size_t h_sizeof(int which)
{
    const size_t sizes[] = {sizeof(struct axis_config),        sizeof(struct axis_state),
                            sizeof(struct axis_trace),         sizeof(struct feedforward_model),
                            sizeof(struct feedforward_tables), sizeof(struct path_config),
                            sizeof(struct path_state),         sizeof(struct pid_state)};
    return sizes[which];
}

/* One tick of a scenario. `command`: an axis_drive to set, 3 for axis_start, 4 for leaving things as they are. */
struct tick {
    uint16_t adc_code;
    uint16_t command;
};

void h_run(const struct axis_config *config, const struct feedforward_tables *tables, const int32_t *wave_q30,
           struct axis_state *state, const struct tick *ticks, struct axis_trace *traces, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (ticks[i].command < 3)
            state->drive = ticks[i].command;
        else if (ticks[i].command == 3)
            axis_start(config, state);
        axis_step(config, tables, wave_q30, state, ticks[i].adc_code, &traces[i]);
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
}

int main(void)
{
    static struct feedforward_tables tables;
    struct feedforward_model model;
    struct axis_config config;
    static int32_t wave_q30[WAVE_POINTS];
    uint32_t scenarios, n;
    take(&scenarios, sizeof scenarios);
    for (uint32_t scenario = 0; scenario < scenarios; scenario++) {
        struct axis_state state = {0};
        int32_t range_f[2];
        take(&config, sizeof config);
        take(&model, sizeof model);
        take(wave_q30, sizeof wave_q30);
        take(range_f, sizeof range_f);
        take(&n, sizeof n);
        enum feedforward_verdict verdict = feedforward_expand(&model, &tables);
        bool covered = verdict == FF_OK && feedforward_lookup(&tables, range_f[0], range_f[1], &config.point);
        give((int64_t)verdict * 2 + covered);
        for (uint32_t i = 0; i < n; i++) {
            struct tick tick;
            struct axis_trace trace;
            take(&tick, sizeof tick);
            h_run(&config, verdict == FF_OK ? &tables : NULL, wave_q30, &state, &tick, &trace, 1);
            give_trace(&trace, &state);
        }
    }
    return 0;
}
#endif
