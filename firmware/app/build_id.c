#include "app/build_id.h"

#include <stddef.h>

#ifndef PHASELEAD_BUILD_ID
#define PHASELEAD_BUILD_ID ""
#endif

static uint8_t hex_digit(char digit)
{
    return (uint8_t)(digit <= '9' ? digit - '0' : digit - 'a' + 10);
}

void build_id(uint8_t id[BUILD_ID_SIZE])
{
    const char *text = PHASELEAD_BUILD_ID;
    for (size_t i = 0; i < BUILD_ID_SIZE && text[0] != 0 && text[1] != 0; i++, text += 2)
        id[i] = (uint8_t)(hex_digit(text[0]) << 4 | hex_digit(text[1]));
}
