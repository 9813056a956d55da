/* The flash of a device in memory, which behaves like flash: erased to ones, programmed to zeros, and dead from the
 * byte on at which the power went. Bits that were on their way then read either way, each time anew: those of the byte
 * that was programmed, and all zeros of a slot whose erase was cut short.
 */
#ifndef PHASELEAD_PORT_HOST_FLASH_H
#define PHASELEAD_PORT_HOST_FLASH_H

#include <stdbool.h>

#include "app/boot_record.h"
#include "app/journal.h"
#include "app/model_store.h"

#define HOST_MODEL_SLOT_SIZE 4096u
#define HOST_JOURNAL_SLOT_SIZE 4096u
#define HOST_IMAGE_SLOT_SIZE 2048u
#define HOST_MODELS_SIZE (FLASH_SLOTS * HOST_MODEL_SLOT_SIZE)
/* What a simulated device keeps: its models and its journal. */
#define HOST_FLASH_SIZE (HOST_MODELS_SIZE + FLASH_SLOTS * HOST_JOURNAL_SLOT_SIZE)
/* And what a restart keeps as well: images and the boot record. */
#define HOST_FLASH_CELLS (HOST_FLASH_SIZE + IMAGE_SLOTS * HOST_IMAGE_SLOT_SIZE + BOOT_RECORD_SIZE)

/* All that is known of a flash; an image is this, or the first HOST_FLASH_SIZE bytes of it. */
struct host_cells {
    uint8_t bytes[HOST_FLASH_CELLS];
    uint8_t doubtful[HOST_FLASH_CELLS]; /* bits that read either way */
    uint32_t seed;                      /* of how they read; not 0 */
};

struct host_flash {
    struct host_cells cells;
    uint64_t writes;
    bool power_limited;
    uint64_t power_left; /* bytes that can still be changed */
};

_Static_assert(FLASH_RECORD_SIZE <= HOST_MODEL_SLOT_SIZE, "a record does not fit its slot");
_Static_assert(JOURNAL_SECTOR_SIZE <= HOST_JOURNAL_SLOT_SIZE, "a sector of the journal does not fit its slot");

/* image: HOST_FLASH_SIZE bytes, only the models' (HOST_MODELS_SIZE, an older version's), a struct host_cells, or NULL;
 * what is missing is erased. False: it has another size. */
bool host_flash_init(struct host_flash *flash, const uint8_t *image, size_t size);
struct flash_port host_flash_models(struct host_flash *flash);
struct flash_port host_flash_journal(struct host_flash *flash);
struct flash_port host_flash_images(struct host_flash *flash);

#endif
