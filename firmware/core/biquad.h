/* One second-order section, direct form I: y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y''.
 *
 * Signals are q40 of whatever unit (micrometres, volts), coefficients q26. The output is exact but for the rounding of
 * its five products, 2.5 LSB of q40 a tick before they go round the loop. Values are limited to +-32768 units.
 */
#ifndef PHASELEAD_CORE_BIQUAD_H
#define PHASELEAD_CORE_BIQUAD_H

#include <stdbool.h>
#include <stdint.h>

#define BIQUAD_ONE_Q26 (1 << 26)

struct biquad_config {
    int32_t b0_q26, b1_q26, b2_q26, a1_q26, a2_q26;
};

struct biquad_state {
    int64_t x1_q40, x2_q40, y1_q40, y2_q40;
};

/* Stable, and with a static gain of exactly 1: 1 + a1 + a2 = b0 + b1 + b2. The one usable section without effect is b0
 * = 1 and nothing else. */
bool biquad_is_usable(const struct biquad_config *config);

/* A section that is not in use passes everything on; it need not be stepped. */
static inline bool biquad_changes(const struct biquad_config *config)
{
    return (config->b1_q26 | config->b2_q26 | config->a1_q26 | config->a2_q26) != 0;
}

/* As if the input had always been this value. */
void biquad_prime(struct biquad_state *state, int64_t value_q40);

int64_t biquad_step_q40(const struct biquad_config *config, struct biquad_state *state, int64_t x_q40, bool *saturated);

#endif
