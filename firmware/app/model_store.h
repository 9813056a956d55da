/* The stage model in the device: uploaded as a transaction, validated, expanded into tables, kept in flash.
 *
 * Two slots in RAM: the active one, and the one an upload is built in. Two slots in flash, each with one record; a
 * save goes to the older, and its header is programmed last, so that a torn write is never taken for a record. Before
 * anything is erased the newer is marked, so that it is known later whether a save was lost.
 */
#ifndef PHASELEAD_APP_MODEL_STORE_H
#define PHASELEAD_APP_MODEL_STORE_H

#include "app/flash_port.h"
#include "app/model_slot.h"

#define FLASH_RECORD_SIZE (16 + WIRE_MODEL_SIZE + 4) /* so much a slot holds at least */

struct model_store {
    struct model_slot slots[2];
    struct wire_axis_model room; /* to unpack an axis into: too large for a board's stack; not for the tick */
    uint8_t active;              /* index of the slot in use */
    bool loaded;
    bool persisted; /* the active model is the newest record in flash */
    bool fallback;  /* a save was lost: the active model is an older one and must be named to arm */
    bool uploading; /* the other slot's blob is being written */
    uint32_t promised_crc;
    uint32_t sequence; /* of the newest record in flash; 0: none */
    uint8_t newest_slot;
    bool littered; /* there is no record that is of use, but flash is not blank */
};

/* Loads the newest whole record, if there is one. */
void model_store_boot(struct model_store *store, const struct flash_port *flash);

const struct model_slot *model_store_active(const struct model_store *store); /* NULL: no model */

enum wire_status model_store_begin(struct model_store *store, uint32_t size, uint32_t crc);
enum wire_status model_store_chunk(struct model_store *store, uint32_t offset, const uint8_t *data, size_t size);

/* Checks, validates and expands what was uploaded. On ok it waits in the inactive slot for model_store_swap(). */
enum wire_status model_store_prepare(struct model_store *store, uint16_t *invalid_field);
const struct model_slot *model_store_prepared(const struct model_store *store);
void model_store_swap(struct model_store *store);

enum wire_status model_store_persist(struct model_store *store, const struct flash_port *flash, uint32_t *sequence);

#endif
