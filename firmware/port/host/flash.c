#include "port/host/flash.h"

#include <string.h>

#define ERASED 0xFF
#define HALF_DONE 0x55 /* the bits of the last byte that still changed when the power went */

void host_flash_init(struct host_flash *flash, const uint8_t *image, size_t size)
{
    memset(flash, 0, sizeof *flash);
    memset(flash->image, ERASED, HOST_FLASH_SIZE);
    if (image)
        memcpy(flash->image, image, size);
    flash->models = (struct host_flash_part){flash, 0};
    flash->journal = (struct host_flash_part){flash, HOST_FLASH_MODELS_SIZE};
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
    const struct host_flash_part *part = context;
    part->flash->writes++;
    for (size_t i = 0; i < HOST_FLASH_SLOT_SIZE; i++)
        if (!change(part->flash, part->offset + slot * HOST_FLASH_SLOT_SIZE + i, ERASED))
            return false;
    return true;
}

static bool program(void *context, unsigned slot, uint32_t offset, const uint8_t *bytes, size_t size)
{
    const struct host_flash_part *part = context;
    struct host_flash *flash = part->flash;
    flash->writes++;
    if (offset > HOST_FLASH_SLOT_SIZE || size > HOST_FLASH_SLOT_SIZE - offset)
        return false;
    for (size_t i = 0; i < size; i++) {
        size_t at = part->offset + slot * HOST_FLASH_SLOT_SIZE + offset + i;
        if (!change(flash, at, flash->image[at] & bytes[i]))
            return false;
    }
    return true;
}

static void read(void *context, unsigned slot, uint32_t offset, uint8_t *bytes, size_t size)
{
    const struct host_flash_part *part = context;
    memcpy(bytes, part->flash->image + part->offset + slot * HOST_FLASH_SLOT_SIZE + offset, size);
}

struct flash_port host_flash_models(struct host_flash *flash)
{
    return (struct flash_port){.erase = erase, .program = program, .read = read, .context = &flash->models};
}

struct flash_port host_flash_journal(struct host_flash *flash)
{
    return (struct flash_port){.erase = erase, .program = program, .read = read, .context = &flash->journal};
}
