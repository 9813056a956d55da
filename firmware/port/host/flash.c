#include "port/host/flash.h"

#include <string.h>

#define ERASED 0xFF
#define HALF_DONE 0x55 /* the bits of the last byte that still changed when the power went */

void host_flash_init(struct host_flash *flash, const uint8_t *image)
{
    memset(flash, 0, sizeof *flash);
    if (image)
        memcpy(flash->image, image, HOST_FLASH_SIZE);
    else
        memset(flash->image, ERASED, HOST_FLASH_SIZE);
}

/* False when the power is gone. */
static bool change(struct host_flash *flash, size_t at, uint8_t to)
{
    uint8_t *byte = &flash->image[at];
    if (flash->power_limited && flash->power_left == 0)
        return false;
    if (flash->power_limited && --flash->power_left == 0)
        to = (uint8_t)((*byte & ~HALF_DONE) | (to & HALF_DONE));
    *byte = to;
    return true;
}

static bool erase(void *context, unsigned slot)
{
    struct host_flash *flash = context;
    flash->writes++;
    for (size_t i = 0; i < HOST_FLASH_SLOT_SIZE; i++)
        if (!change(flash, slot * HOST_FLASH_SLOT_SIZE + i, ERASED))
            return false;
    return true;
}

static bool program(void *context, unsigned slot, uint32_t offset, const uint8_t *bytes, size_t size)
{
    struct host_flash *flash = context;
    flash->writes++;
    if (offset > HOST_FLASH_SLOT_SIZE || size > HOST_FLASH_SLOT_SIZE - offset)
        return false;
    for (size_t i = 0; i < size; i++) {
        size_t at = slot * HOST_FLASH_SLOT_SIZE + offset + i;
        if (!change(flash, at, flash->image[at] & bytes[i]))
            return false;
    }
    return true;
}

static void read(void *context, unsigned slot, uint32_t offset, uint8_t *bytes, size_t size)
{
    const struct host_flash *flash = context;
    memcpy(bytes, flash->image + slot * HOST_FLASH_SLOT_SIZE + offset, size);
}

struct flash_port host_flash_port(struct host_flash *flash)
{
    return (struct flash_port){.erase = erase, .program = program, .read = read, .context = flash};
}
