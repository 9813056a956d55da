/* The device's own filter sections over given signals: how the host shows what rounding their coefficients does. */
#include "core/biquad.h"
#include "port/host/host.h"

void host_run_sections(const int32_t *coefficients_q26, size_t count, int64_t *values_q40, size_t n)
{
    for (size_t k = 0; k < count; k++) {
        const struct biquad_config section = biquad_of(coefficients_q26 + 5 * k);
        struct biquad_state state;
        biquad_prime(&state, 0);
        for (size_t i = 0; i < n; i++) {
            bool saturated = false;
            values_q40[i] = biquad_step_q40(&section, &state, values_q40[i], &saturated);
        }
    }
}
