/* libFuzzer's way to a device: the input chooses what the random host says and does. The invariants of tests/soak and
 * the sanitizers judge. */
#include "random_host.h"

int LLVMFuzzerTestOneInput(const uint8_t *input, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *input, size_t size)
{
    static struct random_host host;
    random_host_begin(&host, size, input, size);
    while (host.input_left > 0)
        random_host_round(&host);
    return 0;
}
