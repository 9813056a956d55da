/* A model worked out as a commit does it. Prints what is wrong with it, 0 for nothing. Usage: expand_model < BLOB */
#include <stdio.h>

#include "app/model_check.h"

static struct model_slot slot;
static struct wire_axis_model room;

int main(void)
{
    if (fread(slot.blob, 1, WIRE_MODEL_SIZE, stdin) != WIRE_MODEL_SIZE)
        return 2;
    printf("%u\n", (unsigned)model_expand(&slot, &room));
    return 0;
}
