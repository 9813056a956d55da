#include "core/creep.h"

#include "core/fixed.h"

#define LIMIT_BITS_Q40 56
#define HALF_Q30 (1 << 29)
#define FOUR 4u
#define ALPHA_MOST_Q64 ((int64_t)1 << 62)

bool creep_make(struct creep_config *config)
{
    int64_t sum_q30 = 0;
    config->fours = 0;
    for (unsigned i = 0; i < CREEP_TERMS; i++) {
        sum_q30 += config->k_q30[i] < 0 ? -(int64_t)config->k_q30[i] : config->k_q30[i];
        if (config->alpha_q64[i] < 0 || config->alpha_q64[i] > ALPHA_MOST_Q64)
            return false;
        if (config->k_q30[i] != 0)
            config->fours |= 1u << i / FOUR;
        else
            config->alpha_q64[i] = 0; /* stays where it is, though it is stepped */
    }
    return sum_q30 <= HALF_Q30;
}

static int64_t bounded(int64_t value_q40)
{
    bool beyond = false;
    return sat_power_i64(value_q40, LIMIT_BITS_Q40, &beyond);
}

void creep_admit(struct creep_state *state)
{
    for (unsigned i = 0; i < CREEP_TERMS; i++)
        state->lag_q40[i] = bounded(state->lag_q40[i]);
}

struct sum { /* high x 2^32 + low, of all products, exactly */
    int64_t high_q38, low_q70;
};

#if defined(__ARM_FEATURE_DSP) && defined(__GNUC__)
/* In the board's own instructions: GCC 12 keeps loads and products so far apart that registers run out. */
static inline void add_term(struct sum *sum, const int64_t *lag_q40, const int32_t *k_q30)
{
    int32_t low, high, k;
    __asm("ldrd  %[low], %[high], %[lag]\n\t"
          "ldr   %[k], %[share]\n\t"
          "add   %[high], %[high], %[low], lsr #31\n\t"
          "smlal %Q[low_sum], %R[low_sum], %[low], %[k]\n\t"
          "smlal %Q[high_sum], %R[high_sum], %[high], %[k]"
          : [low_sum] "+&r"(sum->low_q70), [high_sum] "+&r"(sum->high_q38), [low] "=&r"(low), [high] "=&r"(high),
            [k] "=&r"(k)
          : [lag] "m"(*lag_q40), [share] "m"(*k_q30));
}

static inline void follow_term(int64_t *lag_q40, int64_t d_q40, const int64_t *alpha_q64)
{
    int32_t low, high, alpha_low, alpha_high, d_low, d_high, to_0, to_1; /* as in add_mul_shift64_i64() */
    __asm("ldrd  %[low], %[high], %[lag]\n\t"
          "ldrd  %[al], %[ah], %[alpha]\n\t"
          "subs  %[dl], %Q[d], %[low]\n\t"
          "sbc   %[dh], %R[d], %[high]\n\t"
          "add   %[dh], %[dh], %[dl], lsr #31\n\t"
          "add   %[ah], %[ah], %[al], lsr #31\n\t"
          "mov   %[to_0], #0\n\t"
          "mov   %[to_1], #0x80000000\n\t"
          "smlal %[to_0], %[to_1], %[dl], %[al]\n\t"
          "mov   %[to_0], #0\n\t"
          "smlal %[to_1], %[to_0], %[dh], %[al]\n\t"
          "smlal %[to_1], %[to_0], %[dl], %[ah]\n\t"
          "adds  %[low], %[low], %[to_0]\n\t"
          "adc   %[high], %[high], %[to_0], asr #31\n\t"
          "smlal %[low], %[high], %[dh], %[ah]\n\t"
          "strd  %[low], %[high], %[lag]"
          : [lag] "+m"(*lag_q40), [low] "=&r"(low), [high] "=&r"(high), [al] "=&r"(alpha_low), [ah] "=&r"(alpha_high),
            [dl] "=&r"(d_low), [dh] "=&r"(d_high), [to_0] "=&r"(to_0), [to_1] "=&r"(to_1)
          : [d] "r"(d_q40), [alpha] "m"(*alpha_q64)
          : "cc");
}
#else
static inline void add_term(struct sum *sum, const int64_t *lag_q40, const int32_t *k_q30)
{
    sum->high_q38 += (int64_t)signed_high_i64(*lag_q40) * *k_q30;
    sum->low_q70 += (int64_t)signed_low_i64(*lag_q40) * *k_q30;
}

static inline void follow_term(int64_t *lag_q40, int64_t d_q40, const int64_t *alpha_q64)
{
    *lag_q40 = add_mul_shift64_i64(*lag_q40, d_q40 - *lag_q40, *alpha_q64);
}
#endif

/* Tests of every term would cost more than terms of no effect. */
static inline __attribute__((always_inline)) void
add_four(const struct creep_config *config, const struct creep_state *state, unsigned first, struct sum *sum)
{
    for (unsigned i = 0; i < FOUR; i++)
        add_term(sum, &state->lag_q40[first + i], &config->k_q30[first + i]);
}

int64_t creep_undo_q40(const struct creep_config *config, const struct creep_state *state, int64_t x_q40)
{
    struct sum sum = {0, 1 << 29}; /* the half that rounds */
    if ((config->fours & 1u) != 0)
        add_four(config, state, 0, &sum);
    if ((config->fours & 2u) != 0)
        add_four(config, state, FOUR, &sum);
    return bounded(x_q40 - sum.high_q38 * 4 - floor_shift_i64(sum.low_q70, 30));
}

static inline __attribute__((always_inline)) void follow_four(const struct creep_config *config,
                                                              struct creep_state *state, unsigned first, int64_t d_q40)
{
    for (unsigned i = 0; i < FOUR; i++)
        follow_term(&state->lag_q40[first + i], d_q40, &config->alpha_q64[first + i]);
}

void creep_follow(const struct creep_config *config, struct creep_state *state, int64_t d_q40)
{
    if ((config->fours & 1u) != 0)
        follow_four(config, state, 0, d_q40);
    if ((config->fours & 2u) != 0)
        follow_four(config, state, FOUR, d_q40);
}
