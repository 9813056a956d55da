#include "port/host/flash.h"

#include <string.h>

#define ERASED 0xFF
#define SEED 0x9E3779B9u

/* Slots of the cells, in this order: models, journal, images, boot record. */
#define JOURNAL_SLOT FLASH_SLOTS
#define IMAGE_SLOT (JOURNAL_SLOT + FLASH_SLOTS)

bool host_flash_init(struct host_flash *flash, const uint8_t *image, size_t size)
{
    memset(flash, 0, sizeof *flash);
    memset(flash->cells.bytes, ERASED, HOST_FLASH_CELLS);
    if (image && size != HOST_MODELS_SIZE && size != HOST_FLASH_SIZE && size != sizeof flash->cells)
        return false;
    if (image)
        memcpy(&flash->cells, image, size);
    flash->cells.seed = flash->cells.seed != 0 ? flash->cells.seed : SEED;
    return true;
}

/* The bits of `solid` are certain afterwards. False when the power is gone. */
static bool change(struct host_flash *flash, size_t at, uint8_t to, uint8_t solid)
{
    uint8_t *byte = &flash->cells.bytes[at], *doubtful = &flash->cells.doubtful[at];
    if (flash->power_limited && flash->power_left == 0)
        return false;
    if (flash->power_limited && --flash->power_left == 0) {
        *doubtful |= *byte ^ to;
        return false;
    }
    *byte = to;
    *doubtful &= (uint8_t)~solid;
    return true;
}

static bool erase_from(struct host_flash *flash, size_t from, size_t size)
{
    const bool on = !flash->power_limited || flash->power_left > 0;
    flash->writes++;
    for (size_t i = 0; i < size; i++)
        if (!change(flash, from + i, ERASED, 0xFF)) {
            for (; on && i < size; i++)
                flash->cells.doubtful[from + i] |= (uint8_t)~flash->cells.bytes[from + i];
            return false;
        }
    return true;
}

static bool program_at(struct host_flash *flash, size_t from, const uint8_t *bytes, size_t size)
{
    flash->writes++;
    for (size_t i = 0; i < size; i++)
        if (!change(flash, from + i, flash->cells.bytes[from + i] & bytes[i], (uint8_t)~bytes[i]))
            return false;
    return true;
}

static size_t slot_size(unsigned slot)
{
    if (slot < IMAGE_SLOT) /* NOLINTNEXTLINE(bugprone-branch-clone): two sizes that are equal at present */
        return slot < JOURNAL_SLOT ? HOST_MODEL_SLOT_SIZE : HOST_JOURNAL_SLOT_SIZE;
    return slot < IMAGE_SLOT + BOOT_RECORD_SLOT ? HOST_IMAGE_SLOT_SIZE : BOOT_RECORD_SIZE;
}

static size_t slot_start(unsigned slot)
{
    size_t start = 0;
    for (unsigned before = 0; before < slot; before++)
        start += slot_size(before);
    return start;
}

static bool program(void *context, unsigned slot, uint32_t offset, const uint8_t *bytes, size_t size)
{
    if (offset > slot_size(slot) || size > slot_size(slot) - offset)
        return false;
    return program_at(context, slot_start(slot) + offset, bytes, size);
}

static bool erase(void *context, unsigned slot)
{
    return erase_from(context, slot_start(slot), slot_size(slot));
}

static uint8_t next_random(struct host_cells *cells)
{
    cells->seed ^= cells->seed << 13;
    cells->seed ^= cells->seed >> 17;
    cells->seed ^= cells->seed << 5;
    return (uint8_t)(cells->seed >> 11);
}

static void read(void *context, unsigned slot, uint32_t offset, uint8_t *bytes, size_t size)
{
    struct host_flash *flash = context;
    const size_t from = slot_start(slot) + offset;
    memcpy(bytes, flash->cells.bytes + from, size);
    for (size_t i = 0; i < size; i++)
        if (flash->cells.doubtful[from + i] != 0)
            bytes[i] ^= flash->cells.doubtful[from + i] & next_random(&flash->cells);
}

static bool erase_journal(void *context, unsigned slot)
{
    return erase(context, JOURNAL_SLOT + slot);
}

static bool program_journal(void *context, unsigned slot, uint32_t offset, const uint8_t *bytes, size_t size)
{
    return program(context, JOURNAL_SLOT + slot, offset, bytes, size);
}

static void read_journal(void *context, unsigned slot, uint32_t offset, uint8_t *bytes, size_t size)
{
    read(context, JOURNAL_SLOT + slot, offset, bytes, size);
}

static bool erase_image(void *context, unsigned slot)
{
    return erase(context, IMAGE_SLOT + slot);
}

static bool program_image(void *context, unsigned slot, uint32_t offset, const uint8_t *bytes, size_t size)
{
    return program(context, IMAGE_SLOT + slot, offset, bytes, size);
}

static void read_image(void *context, unsigned slot, uint32_t offset, uint8_t *bytes, size_t size)
{
    read(context, IMAGE_SLOT + slot, offset, bytes, size);
}

struct flash_port host_flash_models(struct host_flash *flash)
{
    return (struct flash_port){.erase = erase, .program = program, .read = read, .context = flash};
}

struct flash_port host_flash_journal(struct host_flash *flash)
{
    return (struct flash_port){
        .erase = erase_journal, .program = program_journal, .read = read_journal, .context = flash};
}

struct flash_port host_flash_images(struct host_flash *flash)
{
    return (struct flash_port){.erase = erase_image, .program = program_image, .read = read_image, .context = flash};
}
