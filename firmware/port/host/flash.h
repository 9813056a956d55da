/* Two flash slots in memory that behave like flash: erased to ones, programmed to zeros, and dead from the byte on at
 * which the power went. */
#ifndef PHASELEAD_PORT_HOST_FLASH_H
#define PHASELEAD_PORT_HOST_FLASH_H

#include <stdbool.h>

#include "app/model_store.h"

#define HOST_FLASH_SLOT_SIZE 4096
#define HOST_FLASH_SIZE (2 * HOST_FLASH_SLOT_SIZE)

struct host_flash {
    uint8_t image[HOST_FLASH_SIZE];
    uint64_t writes;
    bool power_limited;
    uint64_t power_left; /* bytes that can still be changed */
};

_Static_assert(FLASH_RECORD_SIZE <= HOST_FLASH_SLOT_SIZE, "a record does not fit its slot");

/* image: HOST_FLASH_SIZE bytes, or NULL for erased. */
void host_flash_init(struct host_flash *flash, const uint8_t *image);
struct flash_port host_flash_port(struct host_flash *flash);

#endif
