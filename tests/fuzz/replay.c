/* What libFuzzer's own main does with files: replay FILE... */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#define LONGEST 65536

int LLVMFuzzerTestOneInput(const uint8_t *input, size_t size);

int main(int count, char **paths)
{
    static uint8_t input[LONGEST];
    for (int i = 1; i < count; i++) {
        FILE *file = fopen(paths[i], "rb");
        if (!file) {
            fprintf(stderr, "%s: cannot be read\n", paths[i]);
            return 2;
        }
        const size_t size = fread(input, 1, sizeof input, file);
        fclose(file);
        fprintf(stderr, "%s\n", paths[i]); /* the last one said is the one that broke something */
        LLVMFuzzerTestOneInput(input, size);
    }
    return 0;
}
