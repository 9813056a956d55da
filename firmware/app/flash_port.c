#include "app/flash_port.h"

#include <string.h>

bool flash_program_verified(const struct flash_port *flash, unsigned slot, uint32_t offset, const uint8_t *bytes,
                            size_t size)
{
    uint8_t back[32];
    if (!flash->program(flash->context, slot, offset, bytes, size))
        return false;
    for (size_t done = 0; done < size; done += sizeof back) {
        size_t part = size - done < sizeof back ? size - done : sizeof back;
        flash->read(flash->context, slot, offset + (uint32_t)done, back, part);
        if (memcmp(back, bytes + done, part) != 0)
            return false;
    }
    return true;
}
