/* Flash in memory that behaves like flash: erased to ones, programmed to zeros, and dead from the byte on at which the
 * power went. Two slots for models, two for the journal. */
#ifndef PHASELEAD_PORT_HOST_FLASH_H
#define PHASELEAD_PORT_HOST_FLASH_H

#include <stdbool.h>

#include "app/journal.h"
#include "app/model_store.h"

#define HOST_FLASH_SLOT_SIZE 4096
#define HOST_FLASH_MODELS_SIZE (FLASH_SLOTS * HOST_FLASH_SLOT_SIZE)
#define HOST_FLASH_SIZE (2 * HOST_FLASH_MODELS_SIZE)

struct host_flash {
    uint8_t image[HOST_FLASH_SIZE];
    uint64_t writes;
    bool power_limited;
    uint64_t power_left; /* bytes that can still be changed */
    struct host_flash_part {
        struct host_flash *flash;
        size_t offset;
    } models, journal;
};

_Static_assert(FLASH_RECORD_SIZE <= HOST_FLASH_SLOT_SIZE, "a record does not fit its slot");
_Static_assert(JOURNAL_SECTOR_SIZE <= HOST_FLASH_SLOT_SIZE, "a sector of the journal does not fit its slot");

/* image: HOST_FLASH_SIZE bytes; only the models' (an older version's); or none: what is missing is erased. */
void host_flash_init(struct host_flash *flash, const uint8_t *image, size_t size);
struct flash_port host_flash_models(struct host_flash *flash);
struct flash_port host_flash_journal(struct host_flash *flash);

#endif
