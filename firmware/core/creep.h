/* Creep, x = d + sum k_i lag_i[d] with lag_i = 1/(tau_i s + 1), undone: the motion d that ends up at x.
 *
 * d = x - sum k_i lag_i, with the lags stepped by that same d: the inverse needs no coefficients of its own. It exists
 * and is stable when sum |k_i| < 1; here at most 1/2. Lags are exact for a d that is constant over a tick, but for
 * alpha = 1 - exp(-T/tau) as it is given, at most 1/4 (tau of 0.7 ms), and half an LSB of q40 a tick: they stall at
 * most 2^-41/alpha um short (2.3e-7 um for 100 s).
 */
#ifndef PHASELEAD_CORE_CREEP_H
#define PHASELEAD_CORE_CREEP_H

#include <stdbool.h>
#include <stdint.h>

#define CREEP_TERMS 8

struct creep_config { /* terms of no effect have k = 0 */
    int64_t alpha_q64[CREEP_TERMS];
    int32_t k_q30[CREEP_TERMS];
    uint32_t in_use; /* 1: some term has an effect. creep_make() */
    uint32_t reserved;
};

struct creep_state {
    int64_t lag_q40[CREEP_TERMS]; /* um from rest */
};

/* Works out in_use. False when the terms are not usable. This and creep_admit() are not for the tick. */
bool creep_make(struct creep_config *config);

bool creep_is_in_use(const struct creep_config *config);

/* A state that came from elsewhere may hold anything: brings it within what a step takes. */
void creep_admit(struct creep_state *state);

/* d for a displacement x from rest, both um, each below 65536 um. */
int64_t creep_undo_q40(const struct creep_config *config, const struct creep_state *state, int64_t x_q40);

/* x - d, to 2^-15 um. */
int64_t creep_so_far_q16(const struct creep_config *config, const struct creep_state *state);

/* One tick during which the displacement before creep was d, below 65536 um. */
void creep_follow(const struct creep_config *config, struct creep_state *state, int64_t d_q40);

#endif
